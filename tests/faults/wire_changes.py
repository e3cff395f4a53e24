"""What arrives by a vehicle's own link and is not what it seems.

A heading that is wrong, an estimator that nothing holds any more, and other senders with the
vehicle's ids; in virtual time and on sockets.
"""

import asyncio
import math
import struct
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Literal, cast

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.faults.relay import LOCAL_POSITION_NED, Position, with_flags
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.vehicles.mavlink.framing import FrameSplitter, MavlinkFrame, frame_with_payload
from wil_campaign.vehicles.mavlink.heartbeats import HeartbeatKind
from wil_campaign.worlds.frames import Vec3, add

ESTIMATORS = {
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: mavlink.ESTIMATOR_GPS_GLITCH,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: mavlink.EKF_GPS_GLITCHING,
}
"""An estimator's reports, and their flags of a GPS that it rejects."""
COMPANION = HeartbeatKind(mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID)
STATION = HeartbeatKind(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID)
GENERIC = HeartbeatKind(mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_GENERIC)
_STAMPED_MS = frozenset({LOCAL_POSITION_NED, mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION})
_LATER_MS = 10_000
"""A second board was switched on so much later than the first one."""

WireChange = Callable[[MavlinkFrame, RunState], Iterable[bytes]]
Hold = Literal["fix", "absolute", "glitch", "dead reckoning", "height"]
"""What an estimator loses. dead reckoning: its fix and its absolute position, and it says so."""


def through(change: WireChange, vehicle: str = "twin") -> Callable[[VehiclePair, RunState], None]:
    """Return a disturbance: what a vehicle sends goes on as `change` says."""

    def disturb(pair: VehiclePair, run_state: RunState) -> None:
        far: Any = pair.vehicles[vehicle]
        near = far._link._other
        pass_on, splitter = near._take, FrameSplitter()

        def take(data: bytes) -> None:
            for frame in splitter.feed(data):
                for raw in change(frame, run_state):
                    pass_on(raw)

        near._take = take

    return disturb


def padded(frame: MavlinkFrame, size: int) -> bytearray:
    """Return a frame's payload with the zeros that MAVLink 2 cuts off."""
    return bytearray(frame.payload.ljust(size, b"\0"))


def not_a_number(frame: MavlinkFrame) -> bytes:
    """Return a frame whose first value after its time is NaN."""
    payload = padded(frame, 8)
    struct.pack_into("<f", payload, 4, math.nan)
    return frame_with_payload(frame, bytes(payload))


def headed(frame: MavlinkFrame, turned_rad: float) -> bytes:
    """Return an ATTITUDE_QUATERNION with another heading."""
    payload = padded(frame, 48)
    w, x, y, z = struct.unpack_from("<4f", payload, 4)
    c, s = math.cos(turned_rad / 2.0), math.sin(turned_rad / 2.0)
    turned = (c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w)
    struct.pack_into("<4f", payload, 4, *turned)
    return frame_with_payload(frame, bytes(payload))


def without_hold(frame: MavlinkFrame, what: Hold) -> bytes:
    """Return a frame of an estimator, or of its GPS, that has lost something."""
    if frame.message_id in ESTIMATORS:
        absolute = mavlink.ESTIMATOR_POS_HORIZ_ABS if what in {"absolute", "dead reckoning"} else 0
        gone = absolute | (mavlink.ESTIMATOR_POS_VERT_ABS if what == "height" else 0)
        come = ESTIMATORS[frame.message_id] if what in {"glitch", "dead reckoning"} else 0
        return with_flags(frame, lambda flags: flags & ~gone | come)
    if frame.message_id == mavlink.MAVLINK_MSG_ID_GPS_RAW_INT and what in {"fix", "dead reckoning"}:
        payload = padded(frame, 30)
        payload[28:30] = b"\1\3"
        return frame_with_payload(frame, bytes(payload))
    return frame.raw


def numbered(frame: MavlinkFrame, seq: int, payload: bytes | None = None) -> bytes:
    """Return a frame with another number, and another payload where one is given."""
    raw = frame.raw[:4] + bytes([seq % 256]) + frame.raw[5:]
    size = mavlink.mavlink_map[frame.message_id].unpacker.size
    whole = bytes(padded(frame, size)) if payload is None else payload
    return frame_with_payload(frame._replace(raw=raw, seq=seq % 256), whole)


class OtherSender:
    """Somebody else who sends heartbeats with a vehicle's ids, one beside each of its own.

    By them the vehicle is disarmed.
    """

    def __init__(self, kind: HeartbeatKind, text: str = "") -> None:
        self._kind, self._text = kind, text
        self.sent = 0

    def beside(self, frame: MavlinkFrame) -> Iterable[bytes]:
        """Return what it sends beside a frame of the vehicle."""
        if frame.message_id != mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            return
        mav = mavlink.MAVLink(None, frame.system, 1)
        mav.seq = self.sent = self.sent + 1
        message = mavlink.MAVLink_heartbeat_message(*self._kind, 0, 0, 4, 3)
        if self._text:
            message = mavlink.MAVLink_statustext_message(6, self._text.encode())
        mav.seq %= 256
        yield bytes(message.pack(mav))


class Board:
    """A second board behind a vehicle's router: its own sequence, clock and position.

    It stands at a place. aloft_m: it says what the vehicle says, from so far beside it instead.
    """

    def __init__(self, kind: HeartbeatKind, *, aloft_m: Vec3 | None = None) -> None:
        self._kind, self._aloft_m = kind, aloft_m
        self._seq = 77

    def beside(self, frame: MavlinkFrame) -> Iterable[bytes]:
        """Return what it sends beside a frame of the vehicle."""
        if self._aloft_m is not None:
            yield self._moved(frame)
        elif frame.message_id == LOCAL_POSITION_NED:
            yield from self._standing(frame)

    def _moved(self, frame: MavlinkFrame) -> bytes:
        size = mavlink.mavlink_map[frame.message_id].unpacker.size
        payload = padded(frame, size)
        if frame.message_id in _STAMPED_MS:
            (boot_ms,) = struct.unpack_from("<I", payload)
            struct.pack_into("<I", payload, 0, max(0, boot_ms - _LATER_MS))
        if frame.message_id == LOCAL_POSITION_NED and self._aloft_m is not None:
            now = Position.of(frame)
            place = add((now.values[0], now.values[1], now.values[2]), self._aloft_m)
            struct.pack_into("<3f", payload, 4, *place)
        self._seq += 1
        return numbered(frame, self._seq, bytes(payload))

    def _standing(self, frame: MavlinkFrame) -> Iterable[bytes]:
        mav = mavlink.MAVLink(None, frame.system, 1)
        boot_ms = max(0, Position.of(frame).boot_ms - _LATER_MS)
        beat = mavlink.MAVLink_heartbeat_message(*self._kind, 29, 4 << 16 | 3 << 24, 3, 3)
        for message in (
            *([beat] if boot_ms % 1000 < 20 else []),
            mavlink.MAVLink_extended_sys_state_message(0, 1),
            mavlink.MAVLink_local_position_ned_message(boot_ms, 3.0, 4.0, 0.0, 0.0, 0.0, 0.0),
            mavlink.MAVLink_attitude_quaternion_message(boot_ms, 1.0, *(0.0,) * 6),
        ):
            mav.seq = self._seq % 256
            self._seq += 1
            yield bytes(message.pack(mav))


class Router:
    """Numbers all frames of a link anew, so that two senders cannot be told apart by them."""

    def __init__(self) -> None:
        self._seq, self._splitter = 0, FrameSplitter()

    def pass_on(self, raw: bytes) -> Iterable[bytes]:
        """Return frames with the next numbers."""
        for frame in self._splitter.feed(raw):
            self._seq += 1
            yield numbered(frame, self._seq)


HEADINGS = ("steps", "turns", "corrected", "settles")
"""How a heading is wrong: at once or over seconds, from a moment on or until then."""
BOARDS = ("stands", "flies along", "stands, numbered anew", "flies along, numbered anew")
"""What a second board does; numbered anew: by a router, so that its frames are not told apart."""
UIDS = "two uids"
OTHERS: Mapping[str, tuple[HeartbeatKind, str]] = {
    "companion": (COMPANION, ""),
    "station": (STATION, ""),
    "autopilot": (GENERIC, ""),
    "text": (COMPANION, "Landing detected, disarmed"),
}
"""Who else has the vehicle's ids, and what texts it sends instead of heartbeats."""


class WireFault:
    """A fault of what a vehicle's link delivers, from a moment on; a wrong heading until then, too.

    kind: one of HEADINGS, BOARDS, UIDS, OTHERS and Hold. is_active: whether the moment has come.
    offset_m: how far a heading turns, and where a board flies. board: what a second one is.
    """

    def __init__(
        self, kind: str, is_active: Callable[[], bool], offset_m: Vec3, board: HeartbeatKind
    ) -> None:
        self._kind, self._is_active = kind, is_active
        self._turned_rad = math.copysign(math.radians(25.0 + 30.0 * abs(offset_m[0])), offset_m[1])
        self._over_s = 0.5 + 1.5 * abs(offset_m[2])
        self._began_s: float | None = None
        aloft_m = add((3.0, 2.0, 0.0), offset_m) if kind.startswith("flies") else None
        self._board = Board(board, aloft_m=aloft_m)
        self._other = OtherSender(*OTHERS[kind]) if kind in OTHERS else None
        self._router = Router()

    def change(self, frame: MavlinkFrame) -> Iterable[bytes]:
        """Return what goes on in a frame's place."""
        active = self._is_active()
        if self._kind in HEADINGS:
            yield self._headed(frame, active=active)
        elif self._kind in BOARDS:
            own = (frame.raw, *(self._board.beside(frame) if active else ()))
            for raw in own:
                yield from self._router.pass_on(raw) if "anew" in self._kind else (raw,)
        elif self._other is not None:
            yield frame.raw
            yield from self._other.beside(frame) if active else ()
        elif self._kind == UIDS:
            yield frame.raw
            if frame.message_id == mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
                payload = padded(frame, 78)
                payload[8:16], payload[60:78] = b"\x07" * 8, b"\x07" * 18
                yield frame_with_payload(frame, bytes(payload))
        else:
            yield without_hold(frame, cast(Hold, self._kind)) if active else frame.raw

    def _headed(self, frame: MavlinkFrame, *, active: bool) -> bytes:
        """Return a frame with the heading of now."""
        if frame.message_id != mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION:
            return frame.raw
        gone = 0.0
        if active:
            now_s = asyncio.get_running_loop().time()
            self._began_s = now_s if self._began_s is None else self._began_s
            slow = self._kind in {"turns", "settles"}
            gone = min(1.0, (now_s - self._began_s) / self._over_s) if slow else 1.0
        wrong = 1.0 - gone if self._kind in {"corrected", "settles"} else gone
        return headed(frame, wrong * self._turned_rad)
