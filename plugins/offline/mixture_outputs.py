"""Output files of mixtures without a flight: an image, a video, a recording."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Protocol, Self

import cv2

from wil_campaign.foundation.files.document_writer import write_atomically
from wil_campaign.foundation.files.paths import is_file, is_folder, path_exists
from wil_campaign.orchestrator.recording.mcap.mcap_settings import LOSSLESS
from wil_campaign.orchestrator.recording.mcap.mcap_writer import McapRecorder, RecordingReport
from wil_campaign.orchestrator.recording.video import VideoWriter
from wil_campaign.plugins.offline.errors import OfflineError
from wil_campaign.plugins.offline.offline_pairing import MixedPair
from wil_campaign.vehicles.readings import BgrImage, CameraReading
from wil_campaign.vehicles.sources.camera_source import IMAGE_SUFFIXES

_OF_RUNS = ("log.jsonl", "result.json", "judged.msgpack")
"""Files by which the folder of a run is recognised."""


class MixtureOutput(Protocol):
    """An output of mixtures in their order (protocol); a context manager."""

    def __enter__(self) -> Self:
        """Open the output of mixtures. Raises OfflineError, OSError."""

    def receive(self, name: str, pair: MixedPair) -> None:
        """Write a combination's mixture to the output. Raises OfflineError, OSError."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the output of mixtures."""


def write_mixture_image(path: Path, image_bgr: BgrImage) -> None:
    """Write an image atomically. Raises OfflineError, OSError."""
    coded, data = cv2.imencode(path.suffix.lower(), image_bgr)
    if not coded:
        raise OfflineError(f"{path}: cannot be written as {path.suffix}; use .png or .jpg")
    write_atomically(path, data.tobytes())


def is_run_folder(folder: Path) -> bool:
    """Return whether a folder is that of a flown run."""
    return any(is_file(folder / name) for name in _OF_RUNS)


def refuse_file_of_run(path: Path) -> None:
    """Raise OfflineError for an output that would replace a file in the folder of a run."""
    if path_exists(path) and is_run_folder(path.parent):
        raise OfflineError(f"{path}: is a file of a flown run; write to another file")


@contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    """Yield where to write a file that takes the place of `path` once it is whole.

    After an exception, or when nothing was written, the file that was there stays. Raises
    OfflineError, OSError.
    """
    if not is_folder(path.parent):
        raise OfflineError(f"{path}: there is no folder {path.parent}; create it")
    with TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.") as folder:
        written = Path(folder) / path.name
        yield written
        if written.exists():
            written.replace(path)


class ImageOutput:
    """An output of one mixed image; frames without mixture are not written."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._has_image = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Do nothing: the image is written at once."""

    def receive(self, name: str, pair: MixedPair) -> None:
        """Write the first complete mixture as the image."""
        del name
        reading = pair.mixed.reading
        if self._has_image:
            raise OfflineError(
                f"{self._path}: is a single image, and there are several to write; "
                "name a video (.mp4)"
            )
        self._has_image = True
        if isinstance(reading, CameraReading) and pair.mixed.provenance.dropped is None:
            write_mixture_image(self._path, reading.image_bgr)


class _Stacked:
    """An output that is closed as its stack is."""

    _stack: ExitStack

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.__exit__(kind, error, trace)


class VideoOutput(_Stacked):
    """An output of mixed images as a video, at their times."""

    def __init__(self, path: Path, *, rate_hz: float) -> None:
        self._path = path
        self._rate_hz = rate_hz
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            path = stack.enter_context(_replacing(self._path))
            self._video = stack.enter_context(VideoWriter(path=path, rate_hz=self._rate_hz))
            self._stack = stack.pop_all()
        return self

    def receive(self, name: str, pair: MixedPair) -> None:
        """Append a mixture's image to the video."""
        del name
        if isinstance(pair.mixed.reading, CameraReading):
            self._video.write(pair.mixed.reading.t_s, pair.mixed.reading.image_bgr)


class RecordingOutput(_Stacked):
    """An output of mixtures as lossless MCAP. epoch_s: UTC of the run clock's zero."""

    def __init__(self, path: Path, *, epoch_s: float) -> None:
        self._path = path
        self._epoch_s = epoch_s
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            path = stack.enter_context(_replacing(self._path))
            recorder = McapRecorder(
                path=path, epoch_s=self._epoch_s, clock="virtual", settings=LOSSLESS
            )
            self._recorder = stack.enter_context(recorder)
            stack.push(self._require_whole)
            self._stack = stack.pop_all()
        return self

    def receive(self, name: str, pair: MixedPair) -> None:
        """Append a mixture to the MCAP output."""
        provenance = pair.mixed.provenance
        now_s = pair.real.arrived_s if provenance.mixed_s is None else provenance.mixed_s
        self._recorder.mixed(name, pair.mixed.reading, provenance, now_s=now_s)

    def _require_whole(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the recording; raise OSError when it lacks anything."""
        del kind, trace
        report = self._recorder.close()
        if error is None and not report.complete:
            raise OSError(f"{self._path}: cannot be written: {_why_incomplete(report)}")


def _why_incomplete(report: RecordingReport) -> str:
    if report.fault is not None:
        return report.fault
    lost = ", ".join(f"{loss.lost} of {loss.offered} of {loss.topic}" for loss in report.losses)
    errors = [f"{type(error).__name__}: {error}" for error in report.errors[:1]]
    return ": ".join([f"{lost} are missing", *errors])


def output_for_file(path: Path, *, rate_hz: float, epoch_s: float) -> MixtureOutput:
    """Return the output for the suffix of a file. Raises OfflineError."""
    suffix = path.suffix.lower()
    if suffix in IMAGE_SUFFIXES:
        return ImageOutput(path)
    if suffix == ".mp4":
        return VideoOutput(path, rate_hz=rate_hz)
    if suffix == ".mcap":
        return RecordingOutput(path, epoch_s=epoch_s)
    raise OfflineError(f"{path}: name an image (.png), a video (.mp4) or a recording (.mcap)")
