"""Reads recorded runs as inputs of mixing."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from orchestrator.offline.errors import OfflineError
from orchestrator.recording.errors import RecordingError
from orchestrator.recording.mcap_reader import Recorded, RecordedReading, Recording
from orchestrator.recording.recording_facts import latencies_in
from vehicles.readings import Reading, Source
from worlds.files.paths import is_file, is_folder


def recording_file(path: Path) -> Path:
    """Return the recording at a path: the file, or run.mcap in a run's folder.

    Raises OfflineError.
    """
    file = path / "run.mcap" if is_folder(path) else path
    if not is_file(file):
        raise OfflineError(f"{file}: there is no such recording; name a run's folder or an .mcap")
    return file


def items(path: Path) -> Iterator[Recorded]:
    """Yield the items of a recording, in its order. Raises OfflineError."""
    with _offline_errors(path):
        yield from Recording(path)


def facts_of_recording(path: Path) -> Mapping[str, str]:
    """Return the run facts in a recording. Raises OfflineError."""
    recording = Recording(path)
    with _offline_errors(path):
        next(iter(recording), None)
    return recording.facts


@contextmanager
def _offline_errors(path: Path) -> Iterator[None]:
    """Raise the errors of reading a recording as OfflineError."""
    try:
        yield
    except RecordingError as error:
        raise OfflineError(str(error)) from error
    except OSError as error:
        raise OfflineError(f"{path}: cannot be read: {error.strerror or error}") from error


def readings(path: Path, source: Source, sensor: str) -> Iterator[Reading]:
    """Yield a recording's readings of one sensor of a vehicle. Raises OfflineError."""
    for item in items(path):
        if not isinstance(item, RecordedReading):
            continue
        if item.reading.source == source and item.sensor == sensor:
            yield item.reading


def flown_latency_s(folder: Path, vehicle: str, sensor: str) -> float:
    """Return the latency that a recorded run subtracted from a live camera's stamps."""
    return latencies_in(facts_of_recording(recording_file(folder))).get(f"{vehicle} {sensor}", 0.0)
