"""The readings of one topic of an MCAP file, for replay as a sensor."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from mcap.records import Channel, Message, Schema

from wil_campaign.orchestrator.recording.errors import RecordingError
from wil_campaign.orchestrator.recording.mcap.mcap_chunks import RecordStream
from wil_campaign.orchestrator.recording.topic_decoders import TopicDecoders
from wil_campaign.vehicles.readings import Reading
from wil_campaign.vehicles.sources.camera_source import SourceError
from wil_campaign.vehicles.sources.messagepack import BadMessageError
from wil_campaign.worlds.frames import AT_ORIGIN, Pose


class TopicReadings:
    """The readings of a topic of run.mcap, or of a bag of ROS 2, as recorded; a ReadingFile.

    kind: type of the sensor. topic: None if the file has only one topic of that type. mount: the
    sensor's, where messages lack it.
    """

    def __init__(
        self, *, path: Path, kind: str, topic: str | None = None, mount: Pose = AT_ORIGIN
    ) -> None:
        self._path = path
        self._kind = kind
        self._topic = topic
        self._mount = mount
        self._readings: Iterator[Reading] = iter(())
        self.unusable = 0
        """How many unusable messages were skipped."""

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
        self._readings = self._readings_of(self._topic)

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
            f"{self._path}: set `topic` to the readings of type {self._kind} to use (available: "
            f"{listed})"
        )

    def _topics(self) -> Mapping[str, str]:
        kinds: dict[str, str] = {}
        for decoders, message in self._messages():
            topic = decoders.topic(message)
            if topic is not None and topic not in kinds and (kind := decoders.kind(message)):
                kinds[topic] = kind
        return kinds

    def _messages(self) -> Iterator[tuple[TopicDecoders, Message]]:
        decoders = TopicDecoders(mount=self._mount)
        for record in RecordStream(self._path):
            if isinstance(record, Schema | Channel):
                decoders.take(record)
            elif isinstance(record, Message):
                yield decoders, record

    def _readings_of(self, topic: str) -> Iterator[Reading]:
        """Yield the readings of a topic. Raises SourceError, RecordingError, OSError."""
        there, used, why = 0, 0, ""
        for decoders, message in self._messages():
            if decoders.topic(message) != topic:
                continue
            there += 1
            try:
                reading = self._reading(decoders, message)
            except BadMessageError as error:
                self.unusable += 1
                why = str(error)
                continue
            used += 1
            yield reading
        if not there:
            listed = ", ".join(sorted(self._topics())) or "none"
            raise SourceError(f"{self._path}: has no topic {topic!r} (available: {listed})")
        if not used:
            raise SourceError(f"{self.name}: none of its messages is usable; the last one: {why}")

    def _reading(self, decoders: TopicDecoders, message: Message) -> Reading:
        """Return the reading in a message. Raises SourceError for one of another type."""
        kind = decoders.kind(message)
        if kind != self._kind:
            content = f"readings of type {kind}" if kind else "no readable readings"
            raise SourceError(f"{self.name}: has {content}, but the sensor is a {self._kind}")
        try:
            return decoders.reading(message)
        except RecordingError as error:
            raise SourceError(f"{self.name}: {error}") from error
