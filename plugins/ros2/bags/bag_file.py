"""Writes a bag of ROS 2: one MCAP file, with CDR and the definitions of its types."""

from collections import Counter
from typing import IO

from mcap.writer import CompressionType, Writer

from wil_campaign.plugins.ros2.messages.ros_types import RosTypes
from wil_campaign.plugins.ros2.messages.topics import Quality

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
