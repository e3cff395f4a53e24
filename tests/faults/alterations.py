"""How each kind of fault alters what a vehicle says over MAVLink, and what motion capture says."""

import math
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, get_args

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.faults.motion_capture import Alter
from tests.faults.relay import (
    ESTIMATOR_REPORTS,
    LOCAL_POSITION_NED,
    Change,
    Position,
    with_flags,
)
from wil_campaign.vehicles.mavlink.framing import MavlinkFrame, frame_with_payload
from wil_campaign.vehicles.readings import PoseReading
from wil_campaign.worlds.frames import Pose, Vec3, add

Kind = Literal["stop", "freeze", "delay", "bias", "jump", "nan", "duplicate", "clock step"]
KINDS: tuple[Kind, ...] = get_args(Kind)

ATTITUDE_QUATERNION: int = mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION
_STAMPED_MS = frozenset({LOCAL_POSITION_NED, ATTITUDE_QUATERNION, 30, 33, 32, 31})
"""Messages that begin with time_boot_ms, a uint32."""
GROUND_TRUTH: tuple[int, ...] = (
    mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION,
    mavlink.MAVLINK_MSG_ID_SIM_STATE,
)
_ALL_SOUND = 0x33F
"""Flags of attitude, velocity, position and height."""
JUMPS_FRAMES, _JUMPS_READINGS = 25, 50
"""A jump is there for as many, and then away for as many."""

MESSAGES: Mapping[str, tuple[int, ...]] = {
    "position": (LOCAL_POSITION_NED,),
    "velocity": (LOCAL_POSITION_NED,),
    "attitude": (ATTITUDE_QUATERNION,),
    "ground speed": (mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,),
    "heartbeat": (mavlink.MAVLINK_MSG_ID_HEARTBEAT,),
    "landed_state": (mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,),
    "battery": (mavlink.MAVLINK_MSG_ID_SYS_STATUS, mavlink.MAVLINK_MSG_ID_BATTERY_STATUS),
    "estimator": ESTIMATOR_REPORTS,
    "text": (mavlink.MAVLINK_MSG_ID_STATUSTEXT,),
    "acknowledgement": (mavlink.MAVLINK_MSG_ID_COMMAND_ACK,),
    "timesync": (mavlink.MAVLINK_MSG_ID_TIMESYNC,),
    "link": (),
    "ground truth": GROUND_TRUTH,
    "places": GROUND_TRUTH,
}
"""What is altered of a vehicle's own words, and the messages that say it; link: all of them.
places: those in a simulator's ground truth."""
_OF_A_STATE: tuple[Kind, ...] = ("stop", "freeze", "delay", "bias", "jump", "duplicate")
POSSIBLE: Mapping[str, tuple[Kind, ...]] = {
    "position": KINDS,
    "velocity": ("stop", "freeze", "delay", "bias", "jump", "nan"),
    "attitude": KINDS,
    "ground speed": _OF_A_STATE,
    "heartbeat": _OF_A_STATE,
    "landed_state": _OF_A_STATE,
    "battery": _OF_A_STATE,
    "estimator": _OF_A_STATE,
    "text": ("stop", "delay", "duplicate"),
    "acknowledgement": ("stop", "delay", "duplicate"),
    "timesync": ("stop", "delay", "duplicate", "bias"),
    "link": ("stop", "delay", "duplicate", "clock step"),
    "mocap": KINDS,
    "picture": ("stop", "freeze", "delay", "bias", "jump", "nan", "duplicate"),
    "process": ("stop", "freeze"),
}
"""The kinds of fault that each signal can have."""


@dataclass(frozen=True, slots=True)
class Alteration:
    """A kind of fault: a Kind, or one of the field's (`field_faults.POSSIBLE`).

    offset_m: of a bias or jump; step_s: of a delay or a clock, signed.
    """

    kind: str
    offset_m: Vec3
    step_s: float


def signal_change(signal: str, alteration: Alteration) -> Change:
    """Return what goes on in the place of a message of a signal, a key of MESSAGES."""
    return velocity_change(alteration) if signal == "velocity" else frame_change(alteration)


def frame_change(alteration: Alteration) -> Change:
    """Return what goes on in a frame's place, from the first one that it is given on."""
    first: dict[int, bytes] = {}
    count: dict[int, int] = {}

    def change(frame: MavlinkFrame) -> Iterable[tuple[float, bytes]]:
        then = first.setdefault(frame.message_id, frame.raw)
        count[frame.message_id] = number = count.get(frame.message_id, 0) + 1
        match alteration.kind:
            case "stop":
                return
            case "freeze":
                yield 0.0, _stamped(frame, frame._replace(raw=then))
            case "delay":
                yield abs(alteration.step_s), frame.raw
            case "duplicate":
                yield 0.0, then
            case "clock step":
                yield 0.0, _restamped(frame, alteration.step_s)
            case "jump" if number % (2 * JUMPS_FRAMES) >= JUMPS_FRAMES:
                yield 0.0, frame.raw
            case _:
                yield 0.0, _value(frame, alteration)

    return change


def velocity_change(alteration: Alteration) -> Change:
    """Return what goes on in a LOCAL_POSITION_NED's place whose velocity alone is faulty.

    stop: it is zero from then on. A bias is as many m/s as the alteration has metres.
    """
    given: list[tuple[int, Vec3]] = []

    def change(frame: MavlinkFrame) -> Iterable[tuple[float, bytes]]:
        now = Position.of(frame)
        velocity: Vec3 = (now.values[3], now.values[4], now.values[5])
        given.append((now.boot_ms, velocity))
        match alteration.kind:
            case "stop":
                velocity = (0.0, 0.0, 0.0)
            case "freeze":
                velocity = given[0][1]
            case "delay":
                then_ms = now.boot_ms - 1e3 * abs(alteration.step_s)
                velocity = next(
                    (v for at_ms, v in reversed(given) if at_ms <= then_ms), given[0][1]
                )
            case "nan":
                velocity = (math.nan, *velocity[1:])
            case "jump" if len(given) % (2 * JUMPS_FRAMES) >= JUMPS_FRAMES:
                pass
            case _:
                velocity = add(velocity, alteration.offset_m)
        yield 0.0, Position(now.boot_ms, (*now.values[:3], *velocity)).in_place_of(frame)

    return change


def _stamped(now: MavlinkFrame, then: MavlinkFrame) -> bytes:
    """Return what was said then with the stamp of now, where the message has one."""
    if now.message_id not in _STAMPED_MS:
        return then.raw
    payload = now.payload.ljust(4, b"\0")[:4] + then.payload.ljust(255, b"\0")[4:]
    return frame_with_payload(now, _cut(now, payload))


def _restamped(frame: MavlinkFrame, step_s: float) -> bytes:
    if frame.message_id not in _STAMPED_MS:
        return frame.raw
    payload = frame.payload.ljust(4, b"\0")
    boot_ms = struct.unpack("<I", payload[:4])[0] + round(step_s * 1e3)
    return frame_with_payload(frame, struct.pack("<I", max(0, boot_ms)) + payload[4:])


def _value(frame: MavlinkFrame, alteration: Alteration) -> bytes:
    """Return a frame whose values are off, or no numbers."""
    payload = bytearray(frame.payload.ljust(255, b"\0"))
    is_nan = alteration.kind == "nan"
    north_m, east_m, down_m = alteration.offset_m
    match frame.message_id:
        case mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
            _shift(payload, 4, (north_m, east_m, down_m), is_nan=is_nan)
        case mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION:
            # A fifth of a radian for each metre.
            _turn(payload, 4, (0.2 * north_m, 0.2 * east_m, 0.2 * down_m), is_nan=is_nan)
        case mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            payload[6] ^= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        case mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE:
            payload[1] = mavlink.MAV_LANDED_STATE_ON_GROUND
        case mavlink.MAVLINK_MSG_ID_GPS_RAW_INT:
            (speed_cm_s,) = struct.unpack_from("<H", payload, 24)
            struct.pack_into("<H", payload, 24, speed_cm_s + round(100.0 * abs(north_m)))
        case mavlink.MAVLINK_MSG_ID_SYS_STATUS:
            payload[30] = 100
        case mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS | mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT:
            return with_flags(frame, lambda flags: flags | _ALL_SOUND)
        case mavlink.MAVLINK_MSG_ID_TIMESYNC:
            tc1, ts1 = struct.unpack_from("<qq", payload)
            struct.pack_into("<q", payload, 0, tc1 + (round(alteration.step_s * 1e9) if tc1 else 0))
            struct.pack_into("<q", payload, 8, ts1)
        case _:
            return frame.raw
    return frame_with_payload(frame, _cut(frame, bytes(payload)))


def _cut(frame: MavlinkFrame, payload: bytes) -> bytes:
    return payload[: mavlink.mavlink_map[frame.message_id].unpacker.size]


def _shift(payload: bytearray, at: int, by: Vec3, *, is_nan: bool) -> None:
    place = struct.unpack_from("<3f", payload, at)
    moved = (math.nan, *place[1:]) if is_nan else add((place[0], place[1], place[2]), by)
    struct.pack_into("<3f", payload, at, *moved)


def _turn(payload: bytearray, at: int, by_rad: Vec3, *, is_nan: bool) -> None:
    w, x, y, z = struct.unpack_from("<4f", payload, at)
    if is_nan:
        struct.pack_into("<f", payload, at, math.nan)
        return
    turned = (w, x + by_rad[0] / 2.0, y + by_rad[1] / 2.0, z + by_rad[2] / 2.0)
    length = math.hypot(*turned)
    struct.pack_into("<4f", payload, at, *(one / length for one in turned))


def reading_change(alteration: Alteration) -> Alter:
    """Return what motion capture delivers in a reading's place, from the first given on."""
    first: list[PoseReading] = []
    late: list[PoseReading] = []

    def alter(reading: PoseReading) -> Iterable[PoseReading]:
        first.append(reading)
        moved = Pose(add(reading.pose.position_ned_m, alteration.offset_m), reading.pose.q_wxyz)
        match alteration.kind:
            case "freeze":
                yield replace(reading, pose=first[0].pose)
            case "delay":
                late.append(reading)
                while late and late[0].t_s <= reading.t_s - abs(alteration.step_s):
                    yield late.pop(0)
            case "duplicate":
                yield first[0]
            case "bias":
                yield replace(reading, pose=moved)
            case "jump":
                is_off = len(first) % (2 * _JUMPS_READINGS) < _JUMPS_READINGS
                yield replace(reading, pose=moved) if is_off else reading
            case "nan":
                yield replace(reading, pose=Pose((math.nan, 0.0, 0.0), reading.pose.q_wxyz))
            case "clock step":
                yield replace(reading, t_s=reading.t_s + alteration.step_s)
            case _:
                return

    return alter
