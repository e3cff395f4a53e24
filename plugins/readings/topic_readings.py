"""The readings of one topic of an MCAP file, for replay as a sensor.

Decodes messages of an MCAP file as readings: of our recordings, and of ROS 2.
"""

import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from mcap.exceptions import McapError
from mcap.records import Channel, Message, Schema

from wil_campaign.foundation.files.limited_json import loads_limited_json
from wil_campaign.orchestrator.recording.errors import RecordingError
from wil_campaign.orchestrator.recording.mcap.mcap_chunks import RecordStream
from wil_campaign.orchestrator.recording.mcap.mcap_decode import decode_reading_message
from wil_campaign.plugins.readings.depth_images import check_depth_camera, ros1_image
from wil_campaign.plugins.readings.messagepack import BadMessageError
from wil_campaign.plugins.readings.reading_message import SampleStamps
from wil_campaign.plugins.readings.ros2_messages import ROS2_TYPES, read_ros2, ros2_stamp_s
from wil_campaign.plugins.readings.sender_clock import clock_set_text
from wil_campaign.vehicles.readings import DepthReading, Reading, sensor_names, sensor_type_of
from wil_campaign.vehicles.readings.checks import reading_fault
from wil_campaign.vehicles.sources.camera_source import SourceError
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import AT_ORIGIN, Pose

_ROS1_IMAGE = ("ros1", "ros1msg", "sensor_msgs/Image")
"""Encodings and name of the only message of ROS 1 that is read."""
_LATE_S = 5.0
"""A message that is logged more than this after its stamp was stamped by another clock."""
_FAULTS = (
    McapError,
    ValueError,
    KeyError,
    TypeError,
    AttributeError,
    IndexError,
    OverflowError,
    RecursionError,
    struct.error,
)
_MISSING = (
    "messages of ROS 2 need the extra ros, which is not installed: pip install 'wil-campaign[ros]'"
)
Decoder = Callable[[bytes], Any]


class _Timed(NamedTuple):
    """The time of a channel's last message, and when it was logged; s."""

    t_s: float
    logged_s: float
    is_stamped: bool


class TopicDecoders:
    """Decodes an MCAP file's messages by their channels.

    mount: of the sensor, for ROS 2 messages. camera: the model of a depth camera.

    `take` is called with the file's schemas and channels as they appear. The last fix of a ROS 2
    channel is kept: the velocity of the next one is computed from both positions.
    """

    def __init__(self, *, mount: Pose, camera: Intrinsics | None = None) -> None:
        self._mount = mount
        self._camera = camera
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._decoders: dict[int, Decoder] = {}
        self._before: dict[int, Reading] = {}
        self._last_s: dict[int, _Timed] = {}
        self._shift_s: dict[int, float] = {}

    def receive(self, record: Schema | Channel) -> None:
        """Store a schema or a channel of the MCAP file."""
        if isinstance(record, Channel):
            self._channels[record.id] = record
        else:
            self._schemas[record.id] = record

    def topic(self, message: Message) -> str | None:
        """Return the topic of a message; None if its channel is unknown."""
        channel = self._channels.get(message.channel_id)
        return None if channel is None else channel.topic

    def kind(self, message: Message) -> str:
        """Return the sensor type of the reading in a message; "" for other messages."""
        channel = self._channels[message.channel_id]
        if channel.metadata.get("part") == "reading":
            return _own_kind(message.data)
        schema = self._ros2_schema(channel)
        return "" if schema is None else ROS2_TYPES[_ros2_name(schema)].kind

    def reading(self, message: Message) -> Reading:
        """Return the reading in a message.

        Raises BadMessageError for an unusable ROS 2 message, and RecordingError for one that cannot
        be read at all.
        """
        schema = self._ros2_schema(self._channels[message.channel_id])
        if schema is not None:
            return self._ros2_reading(message, schema)
        try:
            reading = decode_reading_message(loads_limited_json(message.data), {})
        except _FAULTS as error:
            raise RecordingError(f"message {message.sequence} cannot be read: {error}") from error
        kind = self.kind(message)
        if sensor_type_of(reading) != kind or kind == "camera":
            raise RecordingError(f"message {message.sequence} is no {kind} reading")
        return self._as_seen(reading) if isinstance(reading, DepthReading) else reading

    def _as_seen(self, reading: DepthReading) -> DepthReading:
        """Return a recorded depth reading as its sensor gave it. Raises BadMessageError."""
        if self._camera is None:
            raise BadMessageError("is a depth image, and the sensor is no depth camera")
        was = reading.intrinsics
        check_depth_camera(
            self._camera, width_px=was.width_px, height_px=was.height_px, fx_px=was.fx_px
        )
        return replace(
            reading,
            intrinsics=self._camera,
            object_ids=None,
            camera_pose=None,
            rendered=False,
            mount=self._mount,
        )

    def _ros2_schema(self, channel: Channel) -> Schema | None:
        """Return the schema of a ROS channel of readings; None for other channels."""
        schema = self._schemas.get(channel.schema_id)
        if schema is None:
            return None
        encodings = (channel.message_encoding, schema.encoding)
        if encodings == ("cdr", "ros2msg"):
            return schema if schema.name in ROS2_TYPES else None
        return schema if (*encodings, schema.name) == _ROS1_IMAGE else None

    def _ros2_reading(self, message: Message, schema: Schema) -> Reading:
        decoder = self._ros2_decoder(schema)
        try:
            decoded = decoder(message.data)
            logged_s, stamped_s = message.log_time * 1e-9, ros2_stamp_s(decoded)
        except _FAULTS as error:
            raise RecordingError(f"message {message.sequence} cannot be read: {error}") from error
        t_s = self._time(message.channel_id, stamped_s, logged_s)
        is_late = 0.0 <= logged_s - t_s <= _LATE_S
        when = SampleStamps(t_s, logged_s if is_late else t_s, "real", self._mount, self._camera)
        before = self._before.get(message.channel_id)
        reading = read_ros2(_ros2_name(schema), decoded, when, before)
        if reading_fault(reading) is None:
            self._before[message.channel_id] = reading
        return reading

    def _time(self, channel_id: int, stamped_s: float, logged_s: float) -> float:
        """Return a message's time: its stamp, or when that is 0 (unset) its log time.

        The first stamp of a simulation's time may be 0, too: the later ones go on from the log time
        of the first, else all of them would be older than it. Raises RecordingError where the
        sender's clock was set between two messages: the later ones would not be due for years.
        """
        last = self._last_s.get(channel_id)
        t_s = stamped_s + self._shift_s.get(channel_id, 0.0) if stamped_s else logged_s
        if last is not None and bool(stamped_s) != last.is_stamped:
            expected_s = last.t_s + logged_s - last.logged_s
            if abs(t_s - expected_s) > _LATE_S:
                t_s = expected_s
                if stamped_s:
                    self._shift_s[channel_id] = t_s - stamped_s
        if last is not None and (why := clock_set_text(t_s - last.t_s, logged_s - last.logged_s)):
            raise RecordingError(f"a stamp {why}")
        self._last_s[channel_id] = _Timed(t_s, logged_s, bool(stamped_s))
        return t_s

    def _ros2_decoder(self, schema: Schema) -> Decoder:
        if (known := self._decoders.get(schema.id)) is not None:
            return known
        if schema.encoding == "ros1msg":
            return ros1_image
        try:
            from mcap_ros2.decoder import DecoderFactory  # noqa: PLC0415  # of an extra
        except ImportError as error:
            raise RecordingError(_MISSING) from error
        try:
            decoder: Decoder | None = DecoderFactory().decoder_for("cdr", schema)
        except Exception as error:  # it raises whatever a damaged definition causes
            raise RecordingError(f"its definition of {schema.name} is damaged: {error}") from error
        if decoder is None:
            raise RecordingError(f"its definition of {schema.name} is of an unsupported kind")
        self._decoders[schema.id] = decoder
        return decoder


def _ros2_name(schema: Schema) -> str:
    """Return the name of a ROS channel's messages in ROS 2."""
    return "sensor_msgs/msg/Image" if schema.encoding == "ros1msg" else schema.name


def _own_kind(data: bytes) -> str:
    """Return the sensor type in a message of our recordings; "" for other messages."""
    try:
        kind = str(loads_limited_json(data)["wil"]["type"])
    except (KeyError, ValueError, TypeError):
        return ""
    return kind if kind in sensor_names() else ""


class TopicReadings:
    """The readings of a topic of run.mcap, or of a bag of ROS 2, as recorded; a ReadingFile.

    kind: type of the sensor. topic: None if the file has only one topic of that type. mount: the
    sensor's, where messages lack it. camera: the model of a depth camera.
    """

    def __init__(
        self,
        *,
        path: Path,
        kind: str,
        topic: str | None = None,
        mount: Pose = AT_ORIGIN,
        camera: Intrinsics | None = None,
    ) -> None:
        self._path = path
        self._kind = kind
        self._topic = topic
        self._mount = mount
        self._camera = camera
        self._stream = RecordStream(path)
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
            f"{listed}){self._damage}"
        )

    @property
    def _damage(self) -> str:
        """Return in words where the recording is cut off or damaged; "" where it is whole."""
        end = self._stream.end
        return "" if end is None or end.whole else f"; it is {end.reason}"

    def _topics(self) -> Mapping[str, str]:
        kinds: dict[str, str] = {}
        for decoders, message in self._messages():
            topic = decoders.topic(message)
            if topic is not None and topic not in kinds and (kind := decoders.kind(message)):
                kinds[topic] = kind
        return kinds

    def _messages(self) -> Iterator[tuple[TopicDecoders, Message]]:
        decoders = TopicDecoders(mount=self._mount, camera=self._camera)
        for record in self._stream:
            if isinstance(record, Schema | Channel):
                decoders.receive(record)
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
            what = f"has no topic {topic!r} (available: {listed}){self._damage}"
            raise SourceError(f"{self._path}: {what}")
        if not used:
            raise SourceError(f"{self.name}: none of its messages is usable; the last one: {why}")
        if self._damage:
            raise SourceError(f"{self.name}: the recording is over{self._damage}")

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
