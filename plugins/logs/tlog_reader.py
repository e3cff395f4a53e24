"""Reads MAVLink logs (.tlog): of ground stations, and of our own runs."""

from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.logs.logged_flight import FlightLogError, LoggedFlight, PowerSample
from wil_campaign.plugins.logs.track_builder import TrackBuilder
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget
from wil_campaign.vehicles.autopilots.registry import autopilot_of
from wil_campaign.vehicles.driver.onboard.parameters import decode_parameter
from wil_campaign.vehicles.driver.session.identity import identity_of
from wil_campaign.vehicles.driver.session.session import ReceivedHeartbeat
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.mavlink.names import enum_name

_STAMP_BYTES = 8
_YEARS_S = (946684800.0, 4102444800.0)
"""2000 and 2100: other stamps are no stamps."""
_AUTOPILOT = mavlink.MAV_COMP_ID_AUTOPILOT1
_NO_CURRENT = -1
_LATE_S, _LATE_FRAMES = 1.0, 20


def read_tlog(path: Path) -> LoggedFlight:
    """Return the flight of the vehicle that a .tlog has most of. Raises LogError."""
    codec = MavlinkCodec(system_id=255, component_id=190)
    skipped, clock = _Skipped(), _OnwardClock()
    taken_bytes = 0
    messages: list[tuple[float, Any]] = []
    for t_s, raw in clock.led_on(_frames(path.read_bytes(), skipped)):
        for frame in codec.split(raw):
            taken_bytes += len(frame.raw)
            if frame.component != _AUTOPILOT or frame.message_id not in _TAKEN:
                continue
            if (message := codec.decode(frame)) is not None:
                messages.append((t_s, message))
    system = _system(messages)
    if system is None:
        raise FlightLogError(
            f"{path} has no message of an autopilot: is it a MAVLink log (.tlog)? Of "
            f"{path.stat().st_size} bytes {skipped.bytes} are none of MAVLink's"
        )
    vehicle = _Vehicle(system)
    for t_s, message in messages:
        if message.get_srcSystem() == system:
            vehicle.receive(t_s, message)
    # The codec keeps the last bytes where they may be the begin of a frame.
    lost = skipped.bytes + codec.bytes_seen - taken_bytes
    problems = [f"{lost} bytes are damaged, and were skipped"] if lost else []
    if clock.back_s:
        problems.append(f"its clock goes back by {clock.back_s:.1f} s, and is led on from there")
    others = sorted({message.get_srcSystem() for _, message in messages} - {system})
    if others:
        names = ", ".join(map(str, others))
        problems.append(f"it has other vehicles, which were left out: system {names}")
    return vehicle.flight(tuple(problems))


class _Skipped:
    """How many bytes of a log are no frames."""

    bytes = 0


class _OnwardClock:
    """Leads the stamps of a log on where the clock that made them was set back.

    back_s: by how much in all. A few frames that come late, of another link, set nothing back.
    """

    def __init__(self) -> None:
        self.back_s = 0.0
        self._last_s = 0.0

    def led_on(self, frames: Iterator[tuple[float, bytes]]) -> Iterator[tuple[float, bytes]]:
        """Yield the frames, with times in seconds of the log's first clock."""
        coming = deque(islice(frames, _LATE_FRAMES))
        while coming:
            stamp_s, raw = coming.popleft()
            coming.extend(islice(frames, 1))
            if self._is_back(stamp_s) and coming and all(self._is_back(t_s) for t_s, _ in coming):
                self.back_s = self._last_s - stamp_s
            self._last_s = max(self._last_s, stamp_s + self.back_s)
            yield stamp_s + self.back_s, raw

    def _is_back(self, stamp_s: float) -> bool:
        return stamp_s + self.back_s < self._last_s - _LATE_S


def _frames(data: bytes, skipped: _Skipped) -> Iterator[tuple[float, bytes]]:
    """Yield the stamp (UTC, seconds) and the bytes of each frame."""
    at = 0
    while at + _STAMP_BYTES + 3 <= len(data):
        length = _frame_length(data, at + _STAMP_BYTES)
        stamp_s = int.from_bytes(data[at : at + _STAMP_BYTES], "big") * 1e-6
        if length == 0 or not _YEARS_S[0] < stamp_s < _YEARS_S[1]:
            at += 1
            skipped.bytes += 1
            continue
        begin = at + _STAMP_BYTES
        if begin + length > len(data):
            break
        yield stamp_s, data[begin : begin + length]
        at = begin + length
    skipped.bytes += len(data) - at


def _frame_length(data: bytes, at: int) -> int:
    """Return the length in bytes of the frame at a place; 0 where none begins."""
    if data[at] == mavlink.PROTOCOL_MARKER_V1:
        return 8 + data[at + 1]
    if data[at] == 0xFD:
        return 12 + data[at + 1] + (13 if data[at + 2] & 1 else 0)
    return 0


def _system(messages: list[tuple[float, Any]]) -> int | None:
    """Return the system id of the autopilot that a log has most messages of."""
    named = {
        message.get_srcSystem()
        for _, message in messages
        if message.get_type() == "HEARTBEAT" and autopilot_of(message.autopilot) is not None
    }
    counts = Counter(message.get_srcSystem() for _, message in messages)
    known = [system for system, _ in counts.most_common() if system in named or not named]
    return known[0] if known else None


class _Vehicle:
    """What the messages of one vehicle say of its flight."""

    def __init__(self, system: int) -> None:
        self._system = system
        self._track = TrackBuilder()
        self._heartbeat: Any | None = None
        self._version: Any | None = None
        self._parameters: list[Any] = []
        self._armed: list[tuple[float, bool]] = []
        self._power: list[PowerSample] = []

    def receive(self, t_s: float, message: Any) -> None:
        _TAKEN[message.get_msgId()](self, t_s, message)

    def heartbeat(self, t_s: float, message: Any) -> None:
        """Take the kind of vehicle, and whether it is armed."""
        if autopilot_of(message.autopilot) is None:
            return
        self._heartbeat = message
        armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        if not self._armed or self._armed[-1][1] is not armed:
            self._armed.append((t_s, armed))

    def version(self, _t_s: float, message: Any) -> None:
        self._version = message

    def local(self, t_s: float, message: Any) -> None:
        """Take a local position."""
        self._track.local(t_s, message.x, message.y, message.z)

    def place(self, t_s: float, message: Any) -> None:
        degrees = (message.lat * 1e-7, message.lon * 1e-7)
        self._track.place(t_s, *degrees, message.alt * 1e-3)

    def origin(self, _t_s: float, message: Any) -> None:
        """Take the origin of the local frame."""
        degrees = (message.latitude * 1e-7, message.longitude * 1e-7)
        self._track.set_origin(*degrees, message.altitude * 1e-3)

    def attitude(self, t_s: float, message: Any) -> None:
        self._track.yaw(t_s, message.yaw)

    def parameter(self, _t_s: float, message: Any) -> None:
        """Take a parameter; how its integers are sent is known with the autopilot."""
        self._parameters.append(message)

    def status(self, t_s: float, message: Any) -> None:
        """Take voltage and current."""
        if 0 < message.voltage_battery < 0xFFFF:
            current = message.current_battery
            amperes = None if current == _NO_CURRENT else current * 0.01
            self._power.append(PowerSample(t_s, message.voltage_battery * 1e-3, amperes))

    def flight(self, problems: tuple[str, ...]) -> LoggedFlight:
        beat = self._heartbeat
        autopilot = None if beat is None else autopilot_of(beat.autopilot)
        kind = "" if beat is None else enum_name("MAV_TYPE", beat.type)
        bytewise = autopilot is not None and autopilot.parameters_bytewise
        firmware = ""
        if autopilot is not None and beat is not None and self._version is not None:
            received = ReceivedHeartbeat(beat, 0.0, 2)
            target = MavlinkTarget(self._system)
            identity = identity_of(autopilot, target, received, self._version, is_simulated=False)
            firmware = f"{identity.version_text} ({identity.git_hash})"
        return LoggedFlight(
            kind="a MAVLink log",
            autopilot=None if autopilot is None else autopilot.name,
            vehicle_type=kind.removeprefix("MAV_TYPE_").lower(),
            firmware=firmware,
            parameters={
                one.param_id: decode_parameter(one.param_value, one.param_type, bytewise=bytewise)
                for one in self._parameters
                if not one.param_id.startswith("_")
            },
            track=self._track.track,
            origin=self._track.origin,
            armed=self._armed,
            power=self._power,
            problems=(*problems, *self._track.problems),
        )


_TAKEN: Mapping[int, Callable[[_Vehicle, float, Any], None]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: _Vehicle.heartbeat,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: _Vehicle.version,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: _Vehicle.local,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: _Vehicle.place,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: _Vehicle.origin,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: _Vehicle.attitude,
    mavlink.MAVLINK_MSG_ID_PARAM_VALUE: _Vehicle.parameter,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: _Vehicle.status,
}
