"""Reads run.mcap: readings with their sensor, provenance and log lines, also of a cut file."""

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Channel, Message, Metadata
from numpy.typing import NDArray

from wil_campaign.foundation.files.limited_json import loads_limited_json
from wil_campaign.orchestrator.recording.errors import RecordingError
from wil_campaign.orchestrator.recording.mcap.mcap_chunks import RecordStream, RecordStreamEnd
from wil_campaign.orchestrator.recording.mcap.mcap_decode import decode_reading_message
from wil_campaign.orchestrator.recording.recorded_images import (
    NotDrawnAgainError,
    RecordedImages,
)
from wil_campaign.vehicles.readings import Drawing, Reading, Source
from wil_campaign.vehicles.readings.image_messages import image_of_message
from wil_campaign.vehicles.readings.messages import Json
from wil_campaign.vehicles.readings.traits import Parts
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

Arrays = dict[str, NDArray[Any]]


@dataclass(frozen=True, slots=True)
class RecordedReading:
    """A reading from an MCAP recording. exact: lossless; a JPEG image is not."""

    sensor: str
    reading: Reading
    exact: bool


@dataclass(frozen=True, slots=True)
class RecordedProvenance:
    """The provenance of a recorded mixture: its fields as JSON values."""

    sensor: str
    log_ns: int
    fields: Mapping[str, Json]


@dataclass(frozen=True, slots=True)
class RecordedEvent:
    """A recorded line of the run's log. level: of foxglove.Log, 2 is information, 4 an error."""

    log_ns: int
    level: int
    name: str
    message: str


Recorded = RecordedReading | RecordedProvenance | RecordedEvent


class Recording:
    """Iterates over the items of an MCAP recording, in the recorded order.

    After an iteration `end` says whether the file is whole, `counts` has its writer's counts (empty
    for a cut file) and `facts` the metadata at its beginning. Foreign topics are skipped.

    Images that the program drew in flight, and that are not in the file, are drawn again.
    not_drawn: called for each of them for which that is not possible, which is left out then; by
    default NotDrawnAgainError is raised. Raises RecordingError for a file that is no recording of
    wil-campaign; OSError.
    """

    def __init__(
        self, path: str | Path, *, not_drawn: Callable[[NotDrawnAgainError], None] | None = None
    ) -> None:
        self._path = Path(path)
        self._not_drawn = not_drawn
        self.end: RecordStreamEnd | None = None
        self.facts: Mapping[str, str] = {}
        self.counts: Mapping[str, str] = {}

    def __iter__(self) -> Iterator[Recorded]:
        return self._items(None)

    def _items(self, wanted: tuple[str, Source] | None) -> Iterator[Recorded]:
        """Yield the recorded items. wanted: only what belongs to a sensor and source."""
        stream = RecordStream(self._path)
        channels: dict[int, Channel] = {}
        images = _ImageDecoder()
        for record in stream:
            if isinstance(record, Channel):
                named = record.metadata.get("sensor"), record.metadata.get("source")
                if wanted is None or named == wanted:
                    channels[record.id] = record
            elif isinstance(record, Metadata):
                self._store_metadata(record)
                images.drawn = RecordedImages(self.facts)
            elif isinstance(record, Message):
                item = self._read_item(channels.get(record.channel_id), record, images)
                if item is not None:
                    yield item
        self.end = stream.end

    def readings(self, sensor: str, source: Source = "real") -> Iterator[Reading]:
        """Yield the readings of one sensor: of the vehicle, its twin, or the mixture of both."""
        for item in self._items((sensor, source)):
            if isinstance(item, RecordedReading):
                yield item.reading

    def arrays(self, sensor: str, source: Source = "real") -> Arrays:
        """Return the readings of one sensor as arrays by their fields: t_s (n,), range_m (n,), ...

        All of them are in memory at once. A pose is a position and a quaternion
        (`arrays_of_readings`). Raises RecordingError where the recording has none of this sensor
        and source.
        """
        found = arrays_of_readings(self.readings(sensor, source))
        if not found:
            raise RecordingError(f"{self._path}: has no readings of '{sensor}' of {source}")
        return found

    def _store_metadata(self, metadata: Metadata) -> None:
        """Store the recording's metadata: its facts and counts."""
        if metadata.name == "wil.recording":
            self.facts = dict(metadata.metadata)
        elif metadata.name == "wil.counts":
            self.counts = dict(metadata.metadata)

    def _read_item(
        self, channel: Channel | None, message: Message, images: "_ImageDecoder"
    ) -> Recorded | None:
        part = channel.metadata.get("part", "") if channel is not None else ""
        if channel is None or part not in _PARTS:
            return None
        try:
            return _interpret(part, channel.metadata, message, images)
        except NotDrawnAgainError as error:
            if self._not_drawn is None:
                raise NotDrawnAgainError(f"{self._path}: {error}") from error
            self._not_drawn(error)
            return None
        except (KeyError, ValueError, TypeError, AttributeError, OverflowError) as error:
            raise RecordingError(
                f"{self._path}: {channel.topic} at {message.log_time} ns cannot be read:"
                f" {type(error).__name__}: {error}"
            ) from error


_PARTS = frozenset({"reading", "drawing", "depth", "ids", "provenance", "event"})


class _ImageDecoder:
    """Keeps recorded depth and ids until the image they belong to is read, or draws it again."""

    def __init__(self) -> None:
        self.drawn = RecordedImages({})
        self._waiting: dict[tuple[str, str, str], tuple[int, NDArray[Any]]] = {}

    def keep(self, key: tuple[str, str, str], document: Json) -> None:
        """Keep a recorded part of an image."""
        self._waiting[key] = (document["wil"]["seq"], image_of_message(document))

    def take(self, source: str, sensor: str, document: Json) -> Parts:
        """Return the parts of an image beside it, or all of one that is drawn again.

        Raises ValueError when one is missing, NotDrawnAgainError.
        """
        drawn, wil = self.drawn.drawn(document), document["wil"]
        if drawn is not None:
            return drawn
        parts: dict[str, NDArray[Any]] = {}
        for part in wil.get("parts", ()):
            seq, array = self._waiting.pop((source, sensor, part), (None, None))
            if array is None or seq != wil["seq"]:
                raise ValueError(f"its {part} is not in the file")
            parts[part] = array
        return parts


def _loads(data: bytes) -> Json:
    """Return a message's document. Raises ValueError, also for one that is too large."""
    document: Json = loads_limited_json(data)
    return document


def _interpret(
    part: str, facts: Mapping[str, str], message: Message, images: _ImageDecoder
) -> Recorded | None:
    """Return the recorded item in an MCAP message."""
    document = _loads(message.data)
    source, sensor = facts["source"], facts["sensor"]
    if part == "event":
        level, name = document["level"], document["name"]
        return RecordedEvent(message.log_time, level, name, document["message"])
    if part == "provenance":
        fields = {name: value for name, value in document.items() if name != "timestamp"}
        return RecordedProvenance(sensor, message.log_time, fields)
    if part not in {"reading", "drawing"}:
        images.keep((source, sensor, part), document)
        return None
    wil = document["wil"]
    reading = decode_reading_message(document, images.take(source, sensor, document))
    return RecordedReading(sensor, reading, wil.get("exact", True))


def arrays_of_readings(readings: Iterable[Reading]) -> Arrays:
    """Return readings of one sensor by their fields, with the units and axes that these have.

    A number is (n,), a vector (n, 3), an image (n, height, width, ...). A pose of name `pose` is
    `pose_position_m` (n, 3) and `pose_q_wxyz` (n, 4), in its parent frame. A field that differs in
    shape from reading to reading, as points do, or that some lack, is (n,) of arrays or None. What
    no reading has is left out, and so are `source`, `sensor`, and intrinsics and drawings of
    images.
    """
    rows = [dict(_values(reading)) for reading in readings]
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: _stacked([row.get(name) for row in rows]) for name in names}


def _values(reading: Reading) -> Iterator[tuple[str, Any]]:
    """Yield the fields of a reading that are numbers, vectors or arrays."""
    for field in dataclasses.fields(reading):
        value = getattr(reading, field.name)
        if isinstance(value, Pose):
            yield f"{field.name}_position_m", value.position_ned_m
            yield f"{field.name}_q_wxyz", value.q_wxyz
        elif value is not None and not isinstance(value, str | Intrinsics | Drawing):
            yield field.name, value


def _stacked(values: list[Any]) -> NDArray[Any]:
    arrays = [None if value is None else np.asarray(value) for value in values]
    shapes = {None if array is None else array.shape for array in arrays}
    if len(shapes) == 1:
        return np.stack([array for array in arrays if array is not None])
    found = np.empty(len(arrays), dtype=object)
    found[:] = arrays
    return found
