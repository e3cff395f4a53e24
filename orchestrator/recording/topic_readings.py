"""The readings of one topic of a recording of ours, to be played as a sensor."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from mcap.records import Channel, Message

from orchestrator.recording.errors import RecordingError
from orchestrator.recording.mcap.mcap_chunks import RecordStream
from orchestrator.recording.mcap.mcap_decode import decode
from vehicles.readings import SENSOR_TYPES, Reading, sensor_type_of
from vehicles.sources.camera_source import SourceError
from worlds.files.limited_json import loads_limited

_IMAGES = frozenset({"camera", "depth"})


class TopicReadings:
    """The readings of a topic of run.mcap, as they were recorded; a ReadingFile.

    kind: type of the sensor. topic: None when the file has one topic of that type.
    """

    def __init__(self, *, path: Path, kind: str, topic: str | None = None) -> None:
        self._path = path
        self._kind = kind
        self._topic = topic
        self._readings: Iterator[Reading] = iter(())

    @property
    def name(self) -> str:
        """Return the recording's path, and the topic."""
        return f"{self._path}:{self._topic}" if self._topic else str(self._path)

    def open(self) -> None:
        """Open the recording and find the topic. Raises SourceError."""
        try:
            self._topic = self._topic or self._only_topic()
        except OSError as error:
            raise SourceError(f"{self._path}: {error.strerror}; check the path") from error
        except RecordingError as error:
            raise SourceError(str(error)) from error
        self._readings = self._of_topic(self._topic)

    def next(self) -> Reading | None:
        """Return the next reading; None at the end. Raises SourceError."""
        try:
            return next(self._readings, None)
        except OSError as error:
            raise SourceError(f"{self._path}: {error.strerror}; check the path") from error
        except RecordingError as error:
            raise SourceError(str(error)) from error

    def close(self) -> None:
        """Close the recording."""
        self._readings = iter(())

    def _only_topic(self) -> str:
        """Return the recording's only topic of this type of sensor. Raises SourceError."""
        there = self._topics()
        fitting = [topic for topic, kind in there.items() if kind == self._kind]
        if len(fitting) == 1:
            return fitting[0]
        listed = ", ".join(sorted(fitting)) or "none"
        raise SourceError(
            f"{self._path}: name by `topic` the readings of type {self._kind} to use (there: "
            f"{listed})"
        )

    def _topics(self) -> Mapping[str, str]:
        """Return the recording's topics of readings of ours, with the type of their sensor."""
        channels: dict[int, Channel] = {}
        found: dict[str, str] = {}
        for record in RecordStream(self._path):
            if isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message) and record.channel_id in channels:
                channel = channels[record.channel_id]
                if channel.metadata.get("part") == "reading" and channel.topic not in found:
                    found[channel.topic] = _type_of(record.data)
        return found

    def _of_topic(self, topic: str) -> Iterator[Reading]:
        """Yield the readings of a topic. Raises SourceError, RecordingError, OSError."""
        channels: dict[int, Channel] = {}
        is_there = False
        for record in RecordStream(self._path):
            if isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message):
                channel = channels.get(record.channel_id)
                if channel is not None and channel.topic == topic:
                    is_there = True
                    yield self._reading(channel, record)
        if not is_there:
            listed = ", ".join(sorted(self._topics())) or "none"
            raise SourceError(f"{self._path}: has no topic {topic!r} (there: {listed})")

    def _reading(self, channel: Channel, message: Message) -> Reading:
        """Return the reading in a message. Raises SourceError for one of another type."""
        kind = _type_of(message.data) if channel.metadata.get("part") == "reading" else ""
        if kind != self._kind or kind in _IMAGES:
            said = f"readings of type {kind}" if kind else "no readings of a recording of ours"
            raise SourceError(f"{self.name}: has {said}, and a {self._kind} is wanted")
        try:
            reading = decode(loads_limited(message.data), {})
        except (KeyError, ValueError, TypeError, AttributeError, OverflowError) as error:
            raise SourceError(
                f"{self.name}: message {message.sequence} cannot be read: {error}"
            ) from error
        if sensor_type_of(reading) != self._kind:
            raise SourceError(f"{self.name}: message {message.sequence} is no {self._kind}")
        return reading


def _type_of(data: bytes) -> str:
    """Return the type of sensor in a message of ours; "" for another message."""
    try:
        kind = str(loads_limited(data)["wil"]["type"])
    except (KeyError, ValueError, TypeError):
        return ""
    return kind if kind in SENSOR_TYPES else ""
