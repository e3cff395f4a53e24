"""The side channel of a vehicle in another process: truth and motion capture out, events in.

One UDP datagram each, little-endian, at most 400 bytes:

    offset  type      what
    0       4 bytes   "WILF"
    4       u8        version, 1
    5       u8        kind: 1 truth, 2 motion capture, 16 event, 17 fault
    6       u16       flags: 1 on ground, 2 motors stopped, 4 velocity known
    8       u32       sequence number, counts up by one per datagram of this sender
    12      u64       time in us: CLOCK_MONOTONIC of the machine, which all its processes share
    20      f64 x 3   position, NED metres, world frame (kinds 1, 2)
    44      f64 x 4   attitude, quaternion wxyz, FRD to NED (kinds 1, 2)
    76      f64 x 3   velocity, NED m/s, world frame (kinds 1, 2)
    100     text      UTF-8 to the end: what was touched (1), name of an event (16), fault (17)

Kinds 16 and 17 have their text at 20.
"""

import math
import struct
from dataclasses import dataclass
from enum import IntEnum, IntFlag

from vehicles.embedded.states import TruthSample
from vehicles.readings import PoseReading, Source
from worlds.frames import Pose, Vec3

MAGIC = b"WILF"
VERSION = 1
_HEAD = struct.Struct("<4sBBHIQ")
_BODY = struct.Struct("<10d")
_MOST_TEXT_BYTES = 256


class FeedError(ValueError):
    """A datagram that is none of the feed's; says why."""


class Kind(IntEnum):
    """What a datagram carries."""

    TRUTH = 1
    MOCAP = 2
    EVENT = 16
    FAULT = 17


class Flag(IntFlag):
    """What else is known."""

    ON_GROUND = 1
    MOTORS_STOPPED = 2
    HAS_VELOCITY = 4


@dataclass(frozen=True, slots=True)
class Motion:
    """Truth or motion capture; text: what was touched, empty for nothing."""

    kind: Kind
    seq: int
    t_us: int
    flags: Flag
    position_ned_m: Vec3
    q_wxyz: tuple[float, float, float, float]
    velocity_ned_m_s: Vec3
    text: str = ""


@dataclass(frozen=True, slots=True)
class Notice:
    """An event of the world, or a fault to make."""

    kind: Kind
    seq: int
    t_us: int
    text: str


Datagram = Motion | Notice


def encode(datagram: Datagram) -> bytes:
    """Return the bytes. Raises FeedError for a text that is too long."""
    text = datagram.text.encode()
    if len(text) > _MOST_TEXT_BYTES:
        raise FeedError(f"text of {len(text)} bytes; at most {_MOST_TEXT_BYTES} are carried")
    flags = datagram.flags if isinstance(datagram, Motion) else Flag(0)
    seq = datagram.seq & 0xFFFFFFFF
    head = _HEAD.pack(MAGIC, VERSION, datagram.kind, flags, seq, datagram.t_us)
    if isinstance(datagram, Notice):
        return head + text
    body = _BODY.pack(*datagram.position_ned_m, *datagram.q_wxyz, *datagram.velocity_ned_m_s)
    return head + body + text


def decode(data: bytes) -> Datagram:
    """Return the datagram. Raises FeedError for what is none."""
    if len(data) < _HEAD.size:
        raise FeedError(f"{len(data)} bytes are too short")
    magic, version, kind, flags, seq, t_us = _HEAD.unpack_from(data)
    if magic != MAGIC or version != VERSION:
        raise FeedError(f"starts with {magic!r} version {version}")
    try:
        if kind in {Kind.EVENT, Kind.FAULT}:
            return Notice(Kind(kind), seq, t_us, _text(data[_HEAD.size :]))
        if kind in {Kind.TRUTH, Kind.MOCAP}:
            return _motion(Kind(kind), Flag(flags & 7), seq, t_us, data[_HEAD.size :])
    except UnicodeDecodeError as error:
        raise FeedError("its text is not UTF-8") from error
    raise FeedError(f"kind {kind} is not known")


def _motion(kind: Kind, flags: Flag, seq: int, t_us: int, body: bytes) -> Motion:
    if len(body) < _BODY.size:
        raise FeedError(f"a body of {len(body)} bytes is too short")
    values = _BODY.unpack_from(body)
    if not all(map(math.isfinite, values)):
        raise FeedError("a number is not finite")
    n, e, d, w, x, y, z, vn, ve, vd = values
    text = _text(body[_BODY.size :])
    return Motion(kind, seq, t_us, flags, (n, e, d), (w, x, y, z), (vn, ve, vd), text)


def _text(data: bytes) -> str:
    if len(data) > _MOST_TEXT_BYTES:
        raise FeedError(f"text of {len(data)} bytes")
    return data.decode()


def truth_datagram(sample: TruthSample, seq: int) -> Motion:
    """Return the datagram of a truth sample."""
    flags = Flag.HAS_VELOCITY
    flags |= Flag.ON_GROUND if sample.on_ground else Flag(0)
    flags |= Flag.MOTORS_STOPPED if sample.motors_stopped else Flag(0)
    return Motion(
        Kind.TRUTH,
        seq,
        round(sample.t_s * 1e6),
        flags,
        sample.pose.position_ned_m,
        sample.pose.q_wxyz,
        sample.velocity_ned_m_s,
        sample.contact or "",
    )


def mocap_datagram(reading: PoseReading, seq: int) -> Motion:
    """Return the datagram of a motion-capture reading."""
    velocity = reading.velocity_ned_m_s
    return Motion(
        Kind.MOCAP,
        seq,
        round(reading.t_s * 1e6),
        Flag(0) if velocity is None else Flag.HAS_VELOCITY,
        reading.pose.position_ned_m,
        reading.pose.q_wxyz,
        velocity or (0.0, 0.0, 0.0),
    )


def truth_sample(datagram: Motion) -> TruthSample:
    """Return the truth sample of a datagram."""
    return TruthSample(
        datagram.t_us / 1e6,
        Pose(datagram.position_ned_m, datagram.q_wxyz),
        datagram.velocity_ned_m_s,
        Flag.ON_GROUND in datagram.flags,
        Flag.MOTORS_STOPPED in datagram.flags,
        datagram.text or None,
    )


def mocap_reading(datagram: Motion, *, arrived_s: float, source: Source) -> PoseReading:
    """Return the motion-capture reading of a datagram."""
    known = Flag.HAS_VELOCITY in datagram.flags
    return PoseReading(
        datagram.t_us / 1e6,
        arrived_s,
        source,
        Pose(datagram.position_ned_m, datagram.q_wxyz),
        datagram.velocity_ned_m_s if known else None,
    )
