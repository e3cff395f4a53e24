"""Reads ArduPilot's logs (.bin), by pymavlink's DFReader."""

import math
import re
from collections.abc import Callable, Mapping
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

from wil_campaign.plugins.logs.logged_flight import FlightLogError, LoggedFlight, PowerSample
from wil_campaign.plugins.logs.track_builder import TrackBuilder

_VERSION = re.compile(r"Ardu(Copter|Plane|Rover|Sub) V?(\S+) \(([0-9a-f]+)\)|APM:Copter V(\S+)")
_FRAME = re.compile(r"Frame: (\w+)")
_ARMED, _DISARMED = 10, 11
"""Ids of EV."""
_PAGES_BYTES = 528
"""What DFReader takes for the unused end of a log."""
_FRAMES = {
    "QUAD": "quadrotor",
    "HEXA": "hexarotor",
    "OCTA": "octorotor",
    "TRI": "tricopter",
    "Y6": "hexarotor",
    "COAX": "coaxial",
}
_CLASSES = {1: "quadrotor", 2: "hexarotor", 3: "octorotor", 7: "tricopter"}
"""Of FRAME_CLASS."""


def read_dataflash(path: Path) -> LoggedFlight:
    """Return the flight of a .bin. Raises LogError."""
    vehicle = _Vehicle()
    left_out = 0
    noise = StringIO()
    try:
        with redirect_stdout(noise), redirect_stderr(noise):
            log = _opened(path)
            try:
                left_out = _bytes_left_out(log)
                while (message := _next(log, from_index=not left_out)) is not None:
                    vehicle.receive(message)
            finally:
                log.filehandle.close()
    except Exception as error:  # DFReader raises whatever a damaged file causes
        raise FlightLogError(
            f"{path} cannot be read as a log of ArduPilot (.bin): {error}"
        ) from error
    if not vehicle.is_any:
        raise FlightLogError(f"{path} has no message of a flight: is it a log of ArduPilot?")
    return vehicle.flight(is_damaged=left_out > 0)


def _opened(path: Path) -> Any:
    """Return pymavlink's reader of a log; its methods raise whatever a damaged file causes."""
    from pymavlink import DFReader  # noqa: PLC0415 - slow to import

    class Reader(DFReader.DFReader_binary):  # type: ignore[misc]  # ships no types
        """Ends where a damaged format has a length of 0: its message would be read for ever."""

        def __init__(self, filename: str) -> None:
            try:
                super().__init__(filename)
            except BaseException:
                self.filehandle.close()
                raise

        def _parse_next(self) -> Any:
            begin = self.offset
            message = super()._parse_next()
            if message is not None and self.offset <= begin:
                raise FlightLogError(f"the format of {message.get_type()} has no length")
            return message

    return Reader(str(path))


def _bytes_left_out(log: Any) -> int:
    """Return how many bytes before the log's end are in no message of DFReader's index.

    The index ends at the first damaged header that names no message. The last page may be unused.
    """
    lengths = {kind: found.len for kind, found in log.formats.items() if log.offsets[kind]}
    end = max((log.offsets[kind][-1] + size for kind, size in lengths.items()), default=0)
    if log.data_len - end >= _PAGES_BYTES:
        end = log.data_len
    return int(end - sum(len(log.offsets[kind]) * size for kind, size in lengths.items()))


def _next(log: Any, *, from_index: bool) -> Any:
    """Return the next message that is taken: by the index, or from behind the last one."""
    if from_index:
        return log.recv_match(type=list(_TAKEN))
    while (message := log.recv_msg()) is not None and message.get_type() not in _TAKEN:
        pass
    return message


class _Vehicle:
    """What the messages of a log say of its vehicle."""

    def __init__(self) -> None:
        self._track = TrackBuilder()
        self._estimator = ""
        self._texts: list[str] = []
        self._parameters: dict[str, float] = {}
        self._armed: list[tuple[float, bool]] = []
        self._power: list[PowerSample] = []
        self.is_any = False

    def receive(self, message: Any) -> None:
        self.is_any = True
        stamp = getattr(message, "TimeUS", None)
        t_s = float(message._timestamp) if stamp is None else float(stamp) * 1e-6  # noqa: SLF001 - its only access
        _TAKEN[message.get_type()](self, t_s, message)

    def local(self, t_s: float, message: Any) -> None:
        """Take a position of the first core of an estimator, of EKF2 and EKF3 the first one."""
        self._estimator = self._estimator or message.get_type()
        if message.get_type() == self._estimator and getattr(message, "C", 0) == 0:
            self._track.local(t_s, message.PN, message.PE, message.PD)
            self._track.yaw(t_s, math.radians(message.Yaw))

    def place(self, t_s: float, message: Any) -> None:
        self._track.place(t_s, message.Lat, message.Lng, message.Alt)

    def origin(self, _t_s: float, message: Any) -> None:
        """Take the origin of the estimator (type 0)."""
        if getattr(message, "Type", 0) == 0:
            self._track.set_origin(message.Lat, message.Lng, message.Alt)

    def attitude(self, t_s: float, message: Any) -> None:
        self._track.yaw(t_s, math.radians(message.Yaw))

    def text(self, _t_s: float, message: Any) -> None:
        """Take a text: the firmware's name, and the frame."""
        self._texts.append(str(message.Message))

    def parameter(self, _t_s: float, message: Any) -> None:
        self._parameters[str(message.Name)] = float(message.Value)

    def event(self, t_s: float, message: Any) -> None:
        """Take arming and disarming."""
        if message.Id in {_ARMED, _DISARMED}:
            self._arm(t_s, armed=message.Id == _ARMED)

    def arming(self, t_s: float, message: Any) -> None:
        self._arm(t_s, armed=bool(message.ArmState))

    def battery(self, t_s: float, message: Any) -> None:
        """Take voltage and current of the first battery."""
        if getattr(message, "Instance", getattr(message, "Inst", 0)) == 0 and message.Volt > 0:
            current = float(getattr(message, "Curr", -1.0))
            amperes = current if current >= 0.0 else None
            self._power.append(PowerSample(t_s, float(message.Volt), amperes))

    def _arm(self, t_s: float, *, armed: bool) -> None:
        if not self._armed or self._armed[-1][1] is not armed:
            self._armed.append((t_s, armed))

    def flight(self, *, is_damaged: bool) -> LoggedFlight:
        named = next((match for text in self._texts if (match := _VERSION.search(text))), None)
        frame = next((match[1] for text in self._texts if (match := _FRAME.search(text))), "")
        by_class = _CLASSES.get(int(self._parameters.get("FRAME_CLASS", 0)), "")
        firmware = ""
        if named is not None:
            firmware = named[4] or f"{named[2].lstrip('V')} ({named[3]})"
        problems = ["it is damaged: its readable part is used"] if is_damaged else []
        if named is not None and named[1] not in {None, "Copter"}:
            problems.append(f"it is a log of Ardu{named[1]}; only multicopters are flown")
        return LoggedFlight(
            kind="a log of ArduPilot",
            autopilot="ardupilot",
            vehicle_type=_FRAMES.get(frame.upper(), by_class),
            firmware=firmware,
            parameters=self._parameters,
            track=self._track.track,
            origin=self._track.origin,
            armed=self._armed,
            power=self._power,
            problems=(*problems, *self._track.problems),
        )


_TAKEN: Mapping[str, Callable[[_Vehicle, float, Any], None]] = {
    "XKF1": _Vehicle.local,
    "NKF1": _Vehicle.local,
    "POS": _Vehicle.place,
    "ORGN": _Vehicle.origin,
    "ATT": _Vehicle.attitude,
    "MSG": _Vehicle.text,
    "PARM": _Vehicle.parameter,
    "EV": _Vehicle.event,
    "ARM": _Vehicle.arming,
    "BAT": _Vehicle.battery,
}
