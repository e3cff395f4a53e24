"""The side channel of a vehicle in another process: truth and motion capture out, events in.

One UDP datagram each, little-endian, at most 480 bytes:

    offset  type      what
    0       4 bytes   "WILF"
    4       u8        version, 1
    5       u8        kind: 1 truth, 2 motion capture, 16 event, 17 fault, 18 pace
    6       u16       flags: 1 on ground, 2 motors stopped, 4 velocity known, 8 what is felt follows
    8       u32       sequence number, counts up by one per datagram of this sender
    12      u64       time in us: CLOCK_MONOTONIC of the machine, which all its processes share
    20      f64 x 3   position, NED metres, world frame (kinds 1, 2)
    44      f64 x 4   attitude, quaternion wxyz, FRD to NED (kinds 1, 2)
    76      f64 x 3   velocity, NED m/s, world frame (kinds 1, 2)
    100     f64 x 3   angular velocity, rad/s, FRD (flag 8)
    124     f64 x 3   specific force, m/s^2, FRD (flag 8)
    148     f64 x 4   thrust of each motor, N (flag 8)
    180     text      UTF-8 to the end: what was touched (1), name of an event (16), fault (17);
                      "wall run rate" (18): the run clock at a time of CLOCK_MONOTONIC, its slope

Kinds 16 to 18 have their text at 20; without flag 8 it stands at 100.
"""

import math
import struct
from dataclasses import dataclass
from enum import IntEnum, IntFlag

from vehicles.clocks.sim_clock_controller import Segment
from vehicles.embedded.physics.states import Thrusts, TruthSample
from vehicles.readings import PoseReading, Source
from worlds.frames import Pose, Vec3

MAGIC = b"WILF"
VERSION = 1
_HEAD = struct.Struct("<4sBBHIQ")
_BODY = struct.Struct("<10d")
_FELT = struct.Struct("<10d")
_MOST_TEXT_BYTES = 256


class FeedError(ValueError):
    """A datagram that is none of the feed's; says why."""


class Kind(IntEnum):
    """What a datagram carries."""

    TRUTH = 1
    MOCAP = 2
    EVENT = 16
    FAULT = 17
    PACE = 18


class Flag(IntFlag):
    """What else is known."""

    ON_GROUND = 1
    MOTORS_STOPPED = 2
    HAS_VELOCITY = 4
    HAS_FELT = 8


_ALL_FLAGS = 15


@dataclass(frozen=True, slots=True)
class ImuTruth:
    """What a vehicle feels: angular velocity and specific force (FRD), thrust of each motor."""

    rates_frd_rad_s: Vec3
    specific_force_frd_m_s2: Vec3
    thrusts_n: Thrusts


@dataclass(frozen=True, slots=True)
class Motion:
    """Truth or motion capture; text: what was touched, empty for nothing.

    HAS_FELT stands in the flags where `felt` is there, and nowhere else.
    """

    kind: Kind
    seq: int
    t_us: int
    flags: Flag
    position_ned_m: Vec3
    q_wxyz: tuple[float, float, float, float]
    velocity_ned_m_s: Vec3
    text: str = ""
    felt: ImuTruth | None = None


@dataclass(frozen=True, slots=True)
class Notice:
    """An event of the world, a fault to make, or how the run clock goes on."""

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
    if isinstance(datagram, Motion) and (datagram.felt is not None) != (Flag.HAS_FELT in flags):
        raise FeedError("HAS_FELT and what is felt go together")
    seq = datagram.seq & 0xFFFFFFFF
    head = _HEAD.pack(MAGIC, VERSION, datagram.kind, flags, seq, datagram.t_us)
    if isinstance(datagram, Notice):
        return head + text
    body = _BODY.pack(*datagram.position_ned_m, *datagram.q_wxyz, *datagram.velocity_ned_m_s)
    felt = datagram.felt
    if felt is not None:
        body += _FELT.pack(*felt.rates_frd_rad_s, *felt.specific_force_frd_m_s2, *felt.thrusts_n)
    return head + body + text


def decode(data: bytes) -> Datagram:
    """Return the datagram. Raises FeedError for what is none."""
    if len(data) < _HEAD.size:
        raise FeedError(f"{len(data)} bytes are too short")
    magic, version, kind, flags, seq, t_us = _HEAD.unpack_from(data)
    if magic != MAGIC or version != VERSION:
        raise FeedError(f"starts with {magic!r} version {version}")
    try:
        if kind in {Kind.EVENT, Kind.FAULT, Kind.PACE}:
            return Notice(Kind(kind), seq, t_us, _text(data[_HEAD.size :]))
        if kind in {Kind.TRUTH, Kind.MOCAP}:
            return _motion(Kind(kind), Flag(flags & _ALL_FLAGS), seq, t_us, data[_HEAD.size :])
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
    felt, rest = (
        _imu_truth(body[_BODY.size :]) if Flag.HAS_FELT in flags else (None, body[_BODY.size :])
    )
    position, attitude, velocity = (n, e, d), (w, x, y, z), (vn, ve, vd)
    return Motion(kind, seq, t_us, flags, position, attitude, velocity, _text(rest), felt)


def _imu_truth(body: bytes) -> tuple[ImuTruth, bytes]:
    """Return what is felt, and the bytes after it."""
    if len(body) < _FELT.size:
        raise FeedError(f"{len(body)} bytes are too short for what is felt")
    values = _FELT.unpack_from(body)
    if not all(map(math.isfinite, values)):
        raise FeedError("a number is not finite")
    p, q, r, x, y, z, a, b, c, d = values
    return ImuTruth((p, q, r), (x, y, z), (a, b, c, d)), body[_FELT.size :]


def _text(data: bytes) -> str:
    if len(data) > _MOST_TEXT_BYTES:
        raise FeedError(f"text of {len(data)} bytes")
    return data.decode()


def pace_text(segment: Segment) -> str:
    """Return the text of a notice of the pace."""
    return f"{segment.wall_s!r} {segment.run_s!r} {segment.rate!r}"


def pace_of(text: str) -> Segment:
    """Return the piece of the clock that a notice of the pace lays. Raises FeedError."""
    try:
        wall_s, run_s, rate = map(float, text.split())
    except ValueError as error:
        raise FeedError(f"{text!r} is no pace") from error
    if not all(map(math.isfinite, (wall_s, run_s, rate))) or rate < 0.0:
        raise FeedError(f"{text!r} is no pace")
    return Segment(wall_s, run_s, rate)


def truth_datagram(sample: TruthSample, seq: int) -> Motion:
    """Return the datagram of a truth sample."""
    flags = Flag.HAS_VELOCITY | Flag.HAS_FELT
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
        ImuTruth(sample.rates_frd_rad_s, sample.specific_force_frd_m_s2, sample.thrusts_n),
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
    sample = TruthSample(
        datagram.t_us / 1e6,
        Pose(datagram.position_ned_m, datagram.q_wxyz),
        datagram.velocity_ned_m_s,
        Flag.ON_GROUND in datagram.flags,
        Flag.MOTORS_STOPPED in datagram.flags,
        datagram.text or None,
    )
    felt = datagram.felt
    if felt is None:
        return sample
    return sample._replace(
        rates_frd_rad_s=felt.rates_frd_rad_s,
        specific_force_frd_m_s2=felt.specific_force_frd_m_s2,
        thrusts_n=felt.thrusts_n,
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
