"""Decodes motion capture messages of named bodies to poses in the world; pure.

docs/motion-capture.md defines the message. It is the same over UDP and ZeroMQ, in MessagePack or
JSON.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from wil_campaign.plugins.readings.messagepack import BadMessageError, MessageHeader
from wil_campaign.vehicles.readings import PoseReading, Source
from wil_campaign.vehicles.sources.arrival_clock import ArrivalClock, RestartMeter
from wil_campaign.vehicles.sources.feed_statistics import FeedMeter, FeedStatistics
from wil_campaign.worlds.frames import Pose, Quat, Vec3, ned_from_enu, quat_multiply, quat_normalize

PROTOCOL = "wil/mocap/1"
MAX_BODIES = 64

_NED_FROM_ENU: Quat = (0.0, 0.5**0.5, 0.5**0.5, 0.0)
"""Half a turn about the axis between x and y swaps them and reverses z."""
_FLU_FROM_FRD: Quat = (0.0, 1.0, 0.0, 0.0)
"""Half a turn about x reverses y and z."""


@dataclass(frozen=True, slots=True)
class BodyPose:
    """One body in a motion capture frame, in NED and FRD. pose: None when it was not seen."""

    name: str
    pose: Pose | None
    velocity_ned_m_s: Vec3 | None = None


@dataclass(frozen=True, slots=True)
class CaptureFrame:
    """A motion capture frame: all bodies. t_s: on the sender's clock, seconds of any epoch."""

    seq: int
    t_s: float
    bodies: tuple[BodyPose, ...]


def decode_frame(data: bytes | memoryview) -> CaptureFrame:
    """Return the motion capture frame in a MessagePack or JSON message. Raises BadMessageError."""
    header = _header(data)
    if header.text("protocol") != PROTOCOL:
        raise BadMessageError(f"it speaks {header.text('protocol')!r:.40}, we speak {PROTOCOL!r}")
    axes = header.text("frame")
    if axes not in {"ned", "enu"}:
        raise BadMessageError(f"`frame` is {axes!r:.20}; known are 'ned' and 'enu'")
    bodies = header.headers("bodies")
    if len(bodies) > MAX_BODIES:
        raise BadMessageError(f"it has {len(bodies)} bodies, more than {MAX_BODIES}")
    found = tuple(_body(each, is_enu=axes == "enu") for each in bodies)
    if len({body.name for body in found}) != len(found):
        raise BadMessageError("`bodies` lists a name twice")
    return CaptureFrame(header.whole("seq"), header.number("t_s"), found)


def pose_from_enu(position_enu_m: Vec3, q_enu_from_flu: Quat) -> Pose:
    """Return a captured body's pose (NED, FRD) given in ENU with FLU axes."""
    turned = quat_multiply(_NED_FROM_ENU, quat_multiply(q_enu_from_flu, _FLU_FROM_FRD))
    return Pose(ned_from_enu(position_enu_m), turned)


class CaptureDecoder:
    """Turns motion capture messages into readings of requested bodies, with statistics.

    bodies: name in the capture system to vehicle. latency_s: sampling to arrival of the quickest
    message, from the system's data sheet or `calibrate`. Poses are in the capture system's own
    frame, which is the world's (`anchor: mocap`). `receive` raises nothing: messages that cannot be
    decoded, and those of a sender that begins anew all the time, are counted in `garbage`, and
    `complaint` is the reason of the last one.
    """

    def __init__(self, *, bodies: Mapping[str, Source], latency_s: float = 0.0) -> None:
        self._bodies = dict(bodies)
        self._clock = ArrivalClock(latency_s=latency_s)
        self._restart_meter = RestartMeter()
        self._meters = {name: FeedMeter() for name in bodies}
        self._last_seq: int | None = None
        self._last_t_s: dict[str, float] = {}
        self._seq = dict.fromkeys(bodies, -1)
        self.garbage = 0
        self.complaint = ""

    def receive(self, data: bytes | memoryview, arrived_s: float) -> list[PoseReading]:
        """Return the readings in a motion capture message that arrived at a run-clock time."""
        try:
            frame = decode_frame(data)
        except BadMessageError as error:
            self.garbage += 1
            self.complaint = str(error)
            return []
        return self.receive_frame(frame, arrived_s)

    def receive_frame(self, frame: CaptureFrame, arrived_s: float) -> list[PoseReading]:
        """Return the readings in a motion capture frame that arrived at a time."""
        last, resets = self._last_seq, self._clock.resets
        if not self._in_order(frame):
            return []
        t_s = self._clock.run_time(frame.t_s, arrived_s)
        if self._clock.resets > resets or (last is not None and frame.seq < last):
            self._restart_meter.add(arrived_s)
            for meter in self._meters.values():
                meter.restarts += 1
        elif last is not None:
            self._count_missing(frame.seq - last - 1)
        if why := self._restart_meter.fault(arrived_s):
            self.garbage += 1
            self.complaint = why
            return []
        seen = {body.name: body for body in frame.bodies}
        readings = (self._reading_of(name, seen.get(name), t_s, arrived_s) for name in self._bodies)
        return [reading for reading in readings if reading is not None]

    def statistics(self, name: str) -> FeedStatistics:
        """Return the statistics of a body's feed. Raises KeyError for an unknown one."""
        return self._meters[name].statistics()

    def _in_order(self, frame: CaptureFrame) -> bool:
        last = self._last_seq
        if last is not None and (
            frame.seq == last or (frame.seq < last and self._clock.is_overtaken(frame.t_s))
        ):
            for meter in self._meters.values():
                meter.out_of_order += 1
            return False
        self._last_seq = frame.seq
        return True

    def _count_missing(self, frames: int) -> None:
        for name, meter in self._meters.items():
            meter.missing += frames
            self._seq[name] += frames

    def _reading_of(
        self, name: str, body: BodyPose | None, t_s: float, arrived_s: float
    ) -> PoseReading | None:
        meter = self._meters[name]
        self._seq[name] += 1
        if body is None or body.pose is None:
            meter.invalid += 1
            return None
        if t_s <= self._last_t_s.get(name, float("-inf")):
            meter.out_of_order += 1
            return None
        self._last_t_s[name] = t_s
        meter.add(t_s=t_s, arrived_s=arrived_s)
        return PoseReading(
            t_s=t_s,
            arrived_s=arrived_s,
            source=self._bodies[name],
            pose=body.pose,
            velocity_ned_m_s=body.velocity_ned_m_s,
            seq=self._seq[name],
        )


def _header(data: bytes | memoryview) -> MessageHeader:
    if bytes(data[:1]) != b"{":
        return MessageHeader.unpack(data)
    try:
        return MessageHeader.of(json.loads(bytes(data)))
    except (ValueError, RecursionError) as error:
        raise BadMessageError(f"the message is not JSON: {error}") from error


def _body(header: MessageHeader, *, is_enu: bool) -> BodyPose:
    """Return the captured body in a part of a motion capture message."""
    name = header.text("name")
    if not header.flag("valid", default=True):
        return BodyPose(name, None)
    position = _vector(header.numbers("position_m", 3))
    w, x, y, z = header.numbers("q_wxyz", 4)
    try:
        q = quat_normalize((w, x, y, z))
    except ValueError as error:
        raise BadMessageError(f"body {name!r:.40}: {error}") from error
    velocity = _vector(header.numbers("velocity_m_s", 3)) if "velocity_m_s" in header else None
    if not is_enu:
        return BodyPose(name, Pose(position, q), velocity)
    turned = ned_from_enu(velocity) if velocity is not None else None
    return BodyPose(name, pose_from_enu(position, q), turned)


def _vector(numbers: Sequence[float]) -> Vec3:
    return (numbers[0], numbers[1], numbers[2])
