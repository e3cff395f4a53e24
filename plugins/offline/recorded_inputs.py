"""Reads recorded runs as inputs of mixing."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from wil_campaign.foundation.files.paths import is_file, is_folder
from wil_campaign.orchestrator.recording.errors import RecordingError
from wil_campaign.orchestrator.recording.recording_facts import latencies_in
from wil_campaign.plugins.offline.errors import OfflineError
from wil_campaign.plugins.python.mcap_reader import Recorded, Recording
from wil_campaign.vehicles.readings import Reading, Source


def recording_file(path: Path) -> Path:
    """Return the recording at a path: the file, or run.mcap in a run's folder.

    Raises OfflineError.
    """
    file = path / "run.mcap" if is_folder(path) else path
    if not is_file(file):
        raise OfflineError(f"{file}: there is no such recording; name a run's folder or an .mcap")
    return file


Lacking = Callable[[Path, str], None]
"""Called after all items of a recording that is not whole: with its file, and what it lacks."""


def recording_items(path: Path, lacking: Lacking | None = None) -> Iterator[Recorded]:
    """Yield the items of a recording, in its order. Raises OfflineError."""
    recording = Recording(path)
    with _offline_errors(path):
        yield from recording
    if lacking is not None and (what := recording_lack_text(recording)):
        lacking(path, what)


def recording_lack_text(recording: Recording) -> str:
    """Return what an iterated recording lacks, as a sentence; empty when it is whole."""
    end = recording.end
    if end is not None and not end.whole:
        return f"the recording is {end.reason}"
    lost = {name: count for name, count in recording.counts.items() if name != "written"}
    missing = ", ".join(f"{name} {count}" for name, count in lost.items() if count != "0")
    return f"the recording lacks messages: {missing}" if missing else ""


def facts_of_recording(path: Path) -> Mapping[str, str]:
    """Return the run facts in a recording. Raises OfflineError."""
    recording = Recording(path, not_drawn=lambda _: None)
    with _offline_errors(path):
        next(iter(recording), None)
    return recording.facts


@contextmanager
def _offline_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except RecordingError as error:
        raise OfflineError(str(error)) from error
    except OSError as error:
        raise OfflineError(f"{path}: cannot be read: {error.strerror or error}") from error


def recorded_sensor_readings(
    path: Path, source: Source, sensor: str, lacking: Lacking | None = None
) -> Iterator[Reading]:
    """Yield a recording's readings of one sensor of a vehicle. Raises OfflineError."""
    recording = Recording(path)
    with _offline_errors(path):
        yield from recording.readings(sensor, source)
    if lacking is not None and (what := recording_lack_text(recording)):
        lacking(path, what)


def flown_latency_s(folder: Path, vehicle: str, sensor: str) -> float:
    """Return the latency that a recorded run subtracted from a live camera's stamps."""
    return latencies_in(facts_of_recording(recording_file(folder))).get(f"{vehicle} {sensor}", 0.0)
