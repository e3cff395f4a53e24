"""A recorded run as a bag of ROS 2: readings and mixtures, poses, transforms, clock, words.

Writes a bag of ROS 2: one MCAP file, with CDR and the definitions of its types.
"""

import json
import math
import struct
from collections import Counter, deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, get_args

from mcap.records import Channel, Message, Metadata
from mcap.writer import CompressionType, Writer

from wil_campaign.foundation.files.limited_json import loads_limited_json
from wil_campaign.orchestrator.reading.trajectory_file import TrajectoryFileRow, read_trajectory
from wil_campaign.orchestrator.recording.errors import RecordingError
from wil_campaign.orchestrator.recording.mcap.mcap_chunks import RecordStream
from wil_campaign.orchestrator.recording.mcap.mcap_decode import (
    decode_reading_message,
    is_reading_channel,
)
from wil_campaign.orchestrator.recording.recorded_images import RecordedImages
from wil_campaign.orchestrator.recording.recording_facts import campaign_in, mounts_in
from wil_campaign.orchestrator.run_results.result_reader import ResultError, read_result
from wil_campaign.plugins.ros2.bags.bag_frames import BagFrames
from wil_campaign.plugins.ros2.messages.reading_messages import (
    Made,
    optical_frame,
    reading_messages,
    ros_word_of_name,
)
from wil_campaign.plugins.ros2.messages.ros_messages import LOG, RosMessages
from wil_campaign.plugins.ros2.messages.ros_types import RosTypes
from wil_campaign.plugins.ros2.messages.topics import (
    CLOCK_TOPIC,
    GOAL,
    ODOMETRY_TOPIC,
    OWN,
    POSE_TOPIC,
    STAGE,
    STATIC_TOPIC,
    TF_TOPIC,
    VERDICT,
    OutTopic,
    Quality,
    sensor_topics,
)
from wil_campaign.safety.model.verdict import DecisiveKind
from wil_campaign.vehicles.readings.image_messages import camera_of_message
from wil_campaign.vehicles.readings.messages import Json
from wil_campaign.worlds.frames import AT_ORIGIN, Pose, quat_from_euler

_UNLIMITED = "{sec: 9223372036, nsec: 854775807}"
_DURABILITY = {"reliable": 2, "latched": 1}


class BagFile:
    """Writes messages of ROS 2 into a stream, as rosbag2's storage of MCAP has them.

    counts: how many messages each topic has.
    """

    def __init__(self, stream: IO[bytes], types: RosTypes) -> None:
        self._types = types
        self._writer = Writer(stream, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library="wil-campaign")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self.counts: Counter[str] = Counter()

    def write(
        self, topic: str, kind: str, cdr: bytes, *, log_ns: int, quality: Quality = "reliable"
    ) -> None:
        """Append a message. kind: its type, as "sensor_msgs/msg/Image". log_ns: when it came."""
        if topic not in self._channels:
            self._channels[topic] = self._register(topic, kind, quality)
        self.counts[topic] += 1
        self._writer.add_message(
            self._channels[topic],
            log_time=log_ns,
            publish_time=log_ns,
            sequence=self.counts[topic],
            data=cdr,
        )

    def finish(self) -> None:
        """Write the last chunk and the index."""
        self._writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it untyped

    def _register(self, topic: str, kind: str, quality: Quality) -> int:
        if kind not in self._schemas:
            definition = self._types.definition(kind).encode()
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", definition)
        hash_ = self._types.hash(kind)
        facts = {"offered_qos_profiles": _profile(quality), "topic_type_hash": hash_}
        return self._writer.register_channel(topic, "cdr", self._schemas[kind], facts)


def _profile(quality: Quality) -> str:
    """Return a quality of service as bags have it, by the numbers of rmw/types.h."""
    depth = 1 if quality == "latched" else 10
    return (
        f"- history: 1\n  depth: {depth}\n  reliability: 1\n"
        f"  durability: {_DURABILITY[quality]}\n  deadline: {_UNLIMITED}\n"
        f"  lifespan: {_UNLIMITED}\n  liveliness: 1\n"
        f"  liveliness_lease_duration: {_UNLIMITED}\n  avoid_ros_namespace_conventions: false\n"
    )


DAMAGED = (
    KeyError,
    ValueError,
    TypeError,
    AttributeError,
    IndexError,
    OverflowError,
    struct.error,
)
"""What reading a recording may raise into which anything may have been written."""
_CLOCK_NS = 10_000_000
"""How far the messages of the clock are apart, at least."""
_NS = 1_000_000_000
_LOG_TOPIC = OutTopic("/rosout", LOG, "latched")
_TOPICS = {topic.name: topic for topic in (*OWN, _LOG_TOPIC)}
_ESTIMATE = tuple(
    f"est_{name}"
    for name in (
        *("north_m", "east_m", "down_m", "roll_rad", "pitch_rad", "yaw_rad"),
        *("v_north_m_s", "v_east_m_s", "v_down_m_s"),
    )
)


@dataclass(frozen=True, slots=True)
class WrittenBag:
    """What a bag has, and lacks. counts: messages by topic.

    left_out: readings by topic of the recording that have no message of ROS 2, or no topic of
    their own. lacks: in words.
    """

    counts: Mapping[str, int]
    left_out: Mapping[str, int]
    lacks: tuple[str, ...]


def write_bag(
    run: Path, stream: IO[bytes], types: RosTypes, *, decodes: bool, allows_cut: bool
) -> WrittenBag:
    """Write a recorded run as a bag. run: its run.mcap.

    decodes: whether images become raw ones. allows_cut: whether a recording that is cut off is
    exported as far as it is whole. Raises RecordingError for one that cannot be exported, one of
    DAMAGED for one with anything else in it; OSError.
    """
    facts, mixed = _begin(run, allows_cut=allows_cut)
    bag = BagFile(stream, types)
    trajectory = read_trajectory(run.parent / "trajectory.csv")
    writing = _Writing(
        bag=bag, types=types, facts=facts, mixed=mixed, rows=trajectory.rows, decodes=decodes
    )
    channels: dict[int, Channel] = {}
    for record in RecordStream(run):
        if isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Message):
            writing.receive(channels[record.channel_id], record)
    writing.end(run.with_name("result.json"))
    bag.finish()
    return WrittenBag(bag.counts, writing.left_out, trajectory.problems)


def _begin(run: Path, *, allows_cut: bool) -> tuple[Mapping[str, str], frozenset[str]]:
    """Return a recording's facts, and the sensors of which it has mixtures.

    Raises RecordingError.
    """
    facts: Mapping[str, str] | None = None
    mixed: set[str] = set()
    stream = RecordStream(run)
    for record in stream:
        if isinstance(record, Metadata) and record.name == "wil.recording":
            facts = record.metadata
        elif isinstance(record, Channel) and record.metadata.get("source") == "mixed":
            mixed.add(record.metadata["sensor"])
    if facts is None:
        raise RecordingError(f"{run}: is no recording of a run: it has no record wil.recording")
    if stream.end is not None and not stream.end.whole and not allows_cut:
        raise RecordingError(f"{run}: is {stream.end.reason}; --cut exports what is before that")
    return facts, frozenset(mixed)


class _Writing:
    """Writes what a recording has, in its order, and rows of the trajectory at their times."""

    def __init__(
        self,
        *,
        bag: BagFile,
        types: RosTypes,
        facts: Mapping[str, str],
        mixed: frozenset[str],
        rows: tuple[TrajectoryFileRow, ...],
        decodes: bool,
    ) -> None:
        self._bag, self._make, self._facts = bag, RosMessages(types), facts
        self._mixed, self._rows, self._decodes = mixed, deque(rows), decodes
        self._subject = "twin" if facts.get("mode") == "sim" else "real"
        self._frames = BagFrames(self._subject, mounts_in(facts))
        self._images = RecordedImages(facts)
        self._owners: dict[str, tuple[str, str]] = {}
        self._epoch_ns: int | None = None
        self._now_ns = self._clock_ns = 0
        self.left_out: Counter[str] = Counter()

    def receive(self, channel: Channel, message: Message) -> None:
        part = channel.metadata.get("part", "")
        if part not in {"reading", "drawing", "event", "transform"}:
            return
        document = loads_limited_json(message.data)
        if self._epoch_ns is None and part != "event":
            # 0: of the fixed transforms
            t_s = document["wil"]["t_s"] if is_reading_channel(channel) else 0.0
            self._start(message.publish_time - round(t_s * _NS))
        if part == "transform":
            return
        self._write_rows(message.log_time)
        self._tick(message.log_time)
        if part == "event":
            self._write_event(document, message.log_time)
        else:
            self._write_reading(channel, document, message)

    def end(self, result: Path) -> None:
        """Write the rest of the trajectory, and the verdict where the run has one."""
        self._write_rows(None)
        try:
            found = read_result(result)
        except ResultError:
            return
        why = f": {found.reason}" if found.reason else ""
        self._write(VERDICT, self._make.text(f"{found.verdict}{why}"), self._now_ns)

    def _start(self, epoch_ns: int) -> None:
        """Begin: with the goal, and the transforms that are known from the start."""
        self._epoch_ns = epoch_ns
        self._now_ns = epoch_ns + (round(self._rows[0].t_s * _NS) if self._rows else 0)
        goal = campaign_in(self._facts).get("goal") or {}
        self._write(GOAL, self._make.text(json.dumps(goal)), self._now_ns)
        self._write_fixed()

    def _tick(self, now_ns: int) -> None:
        self._now_ns = max(self._now_ns, now_ns)
        if now_ns - self._clock_ns >= _CLOCK_NS:
            self._clock_ns = now_ns
            self._write(CLOCK_TOPIC, self._make.clock(now_ns), now_ns)

    def _write_rows(self, until_ns: int | None) -> None:
        """Write the trajectory's rows until a time; None: to its end."""
        while self._rows and self._epoch_ns is not None:
            stamp_ns = self._epoch_ns + round(self._rows[0].t_s * _NS)
            if until_ns is not None and stamp_ns > until_ns:
                return
            self._write_row(self._rows.popleft(), stamp_ns)

    def _write_row(self, row: TrajectoryFileRow, stamp_ns: int) -> None:
        """Write a vehicle's pose as it knew it: transforms, and of the one under test odometry."""
        cells = row.cells
        numbers = [_number(cells.get(name, "")) for name in _ESTIMATE]
        if not all(math.isfinite(number) for number in numbers):
            return
        north, east, down, roll, pitch, yaw, *velocity = numbers
        self._tick(stamp_ns)
        pose = Pose((north, east, down), quat_from_euler(roll, pitch, yaw))
        moving = self._frames.moving(row.vehicle, pose)
        self._write(TF_TOPIC, self._make.transforms(moving, stamp_ns), stamp_ns)
        if row.vehicle == self._subject:
            x, y, z = velocity
            odometry = self._make.odometry(pose, (x, y, z), stamp_ns)
            self._write(ODOMETRY_TOPIC, odometry, stamp_ns)
            self._write(POSE_TOPIC, self._make.pose(pose, stamp_ns), stamp_ns)

    def _write_event(self, document: Json, log_ns: int) -> None:
        """Write a line of the run's log, and the stage or the verdict in it."""
        name, text, level = document["name"], document["message"], document["level"]
        self._write(_LOG_TOPIC.name, self._make.log(name, text, 10 * level, log_ns), log_ns)
        if name == "stage":
            self._write(STAGE, self._make.text(text), log_ns)
        elif name in get_args(DecisiveKind):
            self._write(VERDICT, self._make.text(f"{name}: {text}"), log_ns)

    def _write_reading(self, channel: Channel, document: Json, message: Message) -> None:
        """Write the messages of a reading; of an image as it is encoded, unless it is decoded."""
        wil, recorded = document["wil"], channel.metadata["sensor"]
        source, kind, sensor = wil["source"], wil["type"], wil.get("sensor") or recorded
        prefix = self._prefix(source, recorded, sensor)
        base = f"{prefix}/{ros_word_of_name(sensor)}"
        topics = {
            sensor_topic.name: sensor_topic.type
            for sensor_topic in sensor_topics(base[1:], kind, compressed=True)
        }
        # Names that differ here may not in ROS: then the first of them has the topics.
        owner = self._owners.setdefault(base, (source, recorded))
        if not topics or owner != (source, recorded):
            self.left_out[channel.topic] += 1
            return
        vehicle, log_ns = self._subject if source == "mixed" else source, message.log_time
        within, mount = self._frames.within(vehicle), AT_ORIGIN
        if kind == "camera" and self._images.is_encoded(document) and not self._decodes:
            frame = within + optical_frame(ros_word_of_name(sensor))
            made = self._encoded(document, base, frame, message.publish_time)
        else:
            parts = self._images.drawn(document) or {}
            reading = decode_reading_message({**document, "wil": {**wil, "sensor": sensor}}, parts)
            mount = getattr(reading, "mount", AT_ORIGIN)
            made = reading_messages(
                reading,
                self._make,
                message.publish_time,
                prefix=prefix,
                within=within,
                compressed=False,
            )
        if self._frames.add(vehicle, sensor, kind, mount):
            self._write_fixed()
        for topic, build in made:
            self._bag.write(topic, topics[topic], build(), log_ns=log_ns)

    def _encoded(self, document: Json, base: str, frame: str, stamp_ns: int) -> Iterator[Made]:
        """Yield the messages of an image, with the bytes of the recording."""
        lens, _ = camera_of_message(document)
        encoding, data = self._images.encoded(document)
        yield f"{base}/camera_info", partial(self._make.camera_info, lens, stamp_ns, frame)
        image = partial(self._make.jpeg, data, encoding, stamp_ns, frame)
        yield f"{base}/image_raw/compressed", image

    def _prefix(self, source: str, recorded: str, sensor: str) -> str:
        """Return what a reading's topics begin with: nothing for what the autonomy perceived.

        recorded: the name of a mixture, "camera" or, where there are several, "camera.real".
        """
        if source != "mixed":
            is_perceived = source == self._subject and not any(
                one == sensor or one.startswith(f"{sensor}.") for one in self._mixed
            )
            return "" if is_perceived else f"/{source}"
        whose = recorded.removeprefix(sensor).removeprefix(".")
        return f"/perceived/{whose}" if whose and self._subject not in whose.split("_") else ""

    def _write_fixed(self) -> None:
        """Write all fixed transforms: a subscriber gets the last message alone, by its log time."""
        fixed = self._make.transforms(self._frames.fixed, self._now_ns)
        self._write(STATIC_TOPIC, fixed, self._now_ns)

    def _write(self, name: str, cdr: bytes, log_ns: int) -> None:
        topic = _TOPICS[name]
        self._bag.write(name, topic.type, cdr, log_ns=log_ns, quality=topic.quality)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
