"""Parameters of the autopilot, with care for their types."""

import asyncio
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from vehicles.driver.onboard.parameter_backup import (
    ParameterBackup,
    ParameterValue,
    Restored,
    restore_backups,
)
from vehicles.driver.session.session import Session
from vehicles.errors import ParameterError
from vehicles.mavlink.names import enum_name

_DOUBTS = 2
"""How often an answer with another value is doubted before it is believed."""
_FORMATS: dict[int, str] = {
    mavlink.MAV_PARAM_TYPE_UINT8: "B",
    mavlink.MAV_PARAM_TYPE_INT8: "b",
    mavlink.MAV_PARAM_TYPE_UINT16: "H",
    mavlink.MAV_PARAM_TYPE_INT16: "h",
    mavlink.MAV_PARAM_TYPE_UINT32: "I",
    mavlink.MAV_PARAM_TYPE_INT32: "i",
}


def decode_parameter(wire: float, kind: int, *, bytewise: bool) -> ParameterValue:
    """Return the value of a PARAM_VALUE: kind is its MAV_PARAM_TYPE.

    bytewise: integers stand there as their bytes (PX4); otherwise as a float (ArduPilot).
    """
    code = _FORMATS.get(kind)
    if code is None:
        return wire
    if not bytewise:
        return round(wire)
    value: int = struct.unpack_from("<" + code, struct.pack("<f", wire))[0]
    return value


def encode_parameter(value: ParameterValue, kind: int, *, bytewise: bool) -> float:
    """Return a parameter's value as PARAM_SET holds it; inverse of `decode_parameter`.

    Raises ParameterError when the value does not fit the type.
    """
    code = _FORMATS.get(kind)
    if code is None:
        return float(value)
    if value != int(value):
        raise ParameterError(f"{value} is not whole, and the parameter is an integer")
    try:
        packed = struct.pack("<" + code, int(value))
    except struct.error as error:
        raise ParameterError(f"{value} does not fit the parameter's type ({error})") from error
    if not bytewise:
        return float(value)
    wire: float = struct.unpack("<f", packed.ljust(4, b"\0"))[0]
    return wire


@dataclass(frozen=True, slots=True)
class _Answer:
    """A vehicle's reply about a parameter: value and type."""

    value: ParameterValue
    kind: int


class Parameters:
    """Reads and writes an autopilot's parameters, one at a time."""

    def __init__(self, *, session: Session, timeout_s: float = 0.7, tries: int = 6) -> None:
        self._session = session
        self._timeout_s = timeout_s
        self._tries = tries
        self._bytewise = False
        self._vehicle = ""
        self._turn = asyncio.Lock()
        self._waiting: tuple[str, asyncio.Future[_Answer]] | None = None
        self._answered = False
        session.on(mavlink.MAVLINK_MSG_ID_PARAM_VALUE, self._value_came)
        session.on(mavlink.MAVLINK_MSG_ID_PARAM_ERROR, self._error_came)

    def use_bytewise(self, bytewise: bool) -> None:
        """Set how the autopilot encodes integer parameters."""
        self._bytewise = bytewise

    @property
    def vehicle(self) -> str:
        """Return the vehicle whose parameters these are, as `use_identity` said."""
        return self._vehicle

    def use_identity(self, vehicle: str) -> None:
        """Set whose parameters these are, by a name that is the same at the next start."""
        self._vehicle = vehicle

    def changed(
        self, changes: Mapping[str, ParameterValue], *, journal: Path | None = None
    ) -> ParameterBackup:
        """Return an async context manager in which parameters are changed, in this order.

        journal: a folder that keeps what they were until they are set back, so that
        `restore_leftovers` can do so at the next start after a crash.
        """
        return ParameterBackup(access=self, vehicle=self._vehicle, changes=changes, journal=journal)

    async def restore_backups(self, folder: Path) -> Restored:
        """Restore this vehicle's parameters from killed runs' backups."""
        return await restore_backups(folder, access=self, vehicle=self._vehicle)

    async def get(self, name: str) -> ParameterValue:
        """Return a parameter's value, an int where it is one.

        Raises ParameterError when the autopilot does not answer for it.
        """
        async with self._turn:
            return (await self._read_value(name)).value

    async def set(self, name: str, value: ParameterValue) -> None:
        """Set a parameter and read it back.

        Raises ParameterError when it does not exist, the value does not fit its type, or the
        autopilot keeps another value.
        """
        async with self._turn:
            before = await self._read_value(name)
            try:
                wire = encode_parameter(value, before.kind, bytewise=self._bytewise)
            except ParameterError as error:
                raise ParameterError(f"{self._session.link.name}: {name}: {error}") from error
            wanted = decode_parameter(_as_float32(wire), before.kind, bytewise=self._bytewise)
            message = self._message(
                mavlink.MAVLink_param_set_message, name.encode(), wire, before.kind
            )
            answer = await self._exchange(name, message)
            for _ in range(_DOUBTS):
                if answer.value == wanted:
                    break
                # It may answer what was asked before (a late or doubled frame), and the request
                # itself be lost: read what it is, and if it still differs set it once more.
                answer = await self._read_value(name)
                if answer.value != wanted:
                    answer = await self._exchange(name, message)
            if answer.value != wanted:
                raise ParameterError(
                    f"{self._session.link.name}: {name} did not take {value}, it is "
                    f"{answer.value}; the autopilot limits it, or it is read-only"
                )

    async def _read_value(self, name: str) -> _Answer:
        message = self._message(mavlink.MAVLink_param_request_read_message, name.encode(), -1)
        return await self._exchange(name, message)

    def _message(self, kind: Any, *fields: Any) -> Any:
        target = self._session.target
        if target is None:
            raise ParameterError(f"{self._session.link.name}: no vehicle was identified yet")
        return kind(target.system, target.component, *fields)

    async def _exchange(self, name: str, message: Any) -> _Answer:
        # What was on its way when it was asked says nothing of the time since.
        asked_s = asyncio.get_running_loop().time() + (self._timeout_s if self._tries > 1 else 0.0)
        for _ in range(self._tries):
            future: asyncio.Future[_Answer] = asyncio.get_running_loop().create_future()
            self._waiting = (name, future)
            self._session.send(message)
            try:
                async with asyncio.timeout(self._timeout_s):
                    return await future
            except TimeoutError:
                continue
            finally:
                self._waiting = None
        raise ParameterError(
            f"{self._session.link.name}: no answer about parameter {name}, asked "
            f"{self._tries} times; {self._likely_cause(asked_s)}"
        )

    def _likely_cause(self, since_s: float) -> str:
        """Return why there was most likely no answer, by what came since a time and before."""
        heard_s = self._session.last_heard_s
        if heard_s is None or heard_s < since_s:
            return "nothing else of the vehicle was received meanwhile: the link is down"
        if self._answered:
            return (
                "the vehicle is received and has answered about other parameters: most likely this "
                "one does not exist in its firmware"
            )
        return (
            "the vehicle is received and has answered about no parameter yet: this one does not "
            "exist in its firmware, or what we send does not arrive"
        )

    def _value_came(self, message: Any, _t_s: float) -> None:
        if self._waiting is None or self._waiting[1].done():
            return
        name, future = self._waiting
        if message.param_id == name:
            self._answered = True
            value = decode_parameter(
                message.param_value, message.param_type, bytewise=self._bytewise
            )
            future.set_result(_Answer(value, message.param_type))

    def _error_came(self, message: Any, _t_s: float) -> None:
        if self._waiting is None or self._waiting[1].done():
            return
        name, future = self._waiting
        if message.param_id == name:
            what = enum_name("MAV_PARAM_ERROR", message.error)
            future.set_exception(
                ParameterError(f"{self._session.link.name}: parameter {name}: {what}")
            )


def _as_float32(value: float) -> float:
    """Return a parameter's value in single precision."""
    single: float = struct.unpack("<f", struct.pack("<f", value))[0]
    return single
