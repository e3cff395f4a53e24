"""Reads and writes the autopilot's parameters, whose integers PX4 and ArduPilot encode apart."""

import asyncio
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.driver.onboard.parameter_backup import (
    ParameterBackup,
    ParameterValue,
    RestoredParameters,
    restore_backups,
)
from wil_campaign.vehicles.driver.session.session import MavlinkSession
from wil_campaign.vehicles.errors import ParameterError
from wil_campaign.vehicles.mavlink.names import enum_name

_RECHECKS = 2
"""How often a reply with another value is checked again before it counts."""
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

    bytewise: integers are sent as their bytes (PX4); otherwise as a float (ArduPilot).
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

    Raises ParameterError when the value does not fit the type, or cannot be sent as its bytes.
    """
    code = _FORMATS.get(kind)
    if code is None:
        return float(value)
    if value != int(value):
        raise ParameterError(f"{value} is not a whole number, and the parameter is an integer")
    try:
        packed = struct.pack("<" + code, int(value))
    except struct.error as error:
        raise ParameterError(f"{value} does not fit the parameter's type ({error})") from error
    if not bytewise:
        return float(value)
    wire: float = struct.unpack("<f", packed.ljust(4, b"\0"))[0]
    if decode_parameter(wire, kind, bytewise=True) != value:
        # Floats quieten a signalling NaN, which sets another bit.
        raise ParameterError(f"{value} cannot be sent: its bytes are those of a signalling NaN")
    return wire


@dataclass(frozen=True, slots=True)
class _Answer:
    """A vehicle's reply about a parameter: value and type."""

    value: ParameterValue
    kind: int


class OnboardParameters:
    """Reads and writes an autopilot's parameters, one at a time."""

    def __init__(self, *, session: MavlinkSession, timeout_s: float = 0.7, tries: int = 6) -> None:
        self._session = session
        self._timeout_s = timeout_s
        self._tries = tries
        self._bytewise = False
        self._vehicle = ""
        self._turn = asyncio.Lock()
        self._waiting: tuple[str, asyncio.Future[_Answer]] | None = None
        self._answered: set[str] = set()
        session.on(mavlink.MAVLINK_MSG_ID_PARAM_VALUE, self._on_value)
        session.on(mavlink.MAVLINK_MSG_ID_PARAM_ERROR, self._on_error)

    def use_bytewise(self, bytewise: bool) -> None:
        """Set how the autopilot encodes integer parameters."""
        self._bytewise = bytewise

    @property
    def vehicle(self) -> str:
        """Return the name of the vehicle that `use_identity` set."""
        return self._vehicle

    def use_identity(self, vehicle: str) -> None:
        """Set the name of the vehicle, which is the same at the next start."""
        self._vehicle = vehicle

    def changed(
        self, changes: Mapping[str, ParameterValue], *, backup_folder: Path | None = None
    ) -> ParameterBackup:
        """Return an async context manager in which parameters are changed, in this order.

        backup_folder: a folder for their original values until they are restored, so that
        `restore_backups` can restore them at the next start after a crash.
        """
        return ParameterBackup(
            access=self, vehicle=self._vehicle, changes=changes, folder=backup_folder
        )

    async def restore_backups(self, folder: Path) -> RestoredParameters:
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
            for _ in range(_RECHECKS):
                if answer.value == wanted:
                    break
                # This may be a reply to an earlier request (a late or doubled frame), and this
                # request may be lost: read the value, and if it still differs set it once more.
                answer = await self._read_value(name)
                if answer.value != wanted:
                    answer = await self._exchange(name, message)
            if answer.value != wanted:
                raise ParameterError(
                    f"{self._session.link.name}: {name} was set to {value}, but is "
                    f"{answer.value}; the autopilot limits it, or it is read-only"
                )

    async def _read_value(self, name: str) -> _Answer:
        message = self._message(mavlink.MAVLink_param_request_read_message, name.encode(), -1)
        return await self._exchange(name, message)

    def _message(self, kind: Any, *fields: Any) -> Any:
        target = self._session.target
        if target is None:
            raise ParameterError(f"{self._session.link.name}: no vehicle is identified yet")
        return kind(target.system, target.component, *fields)

    async def _exchange(self, name: str, message: Any) -> _Answer:
        # Frames that were already in flight do not show that the link still works.
        since_s = asyncio.get_running_loop().time() + (self._timeout_s if self._tries > 1 else 0.0)
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
            f"{self._session.link.name}: no reply for parameter {name}, requested "
            f"{self._tries} times; {self._likely_cause(name, since_s)}"
        )

    def _likely_cause(self, name: str, since_s: float) -> str:
        """Return the most likely cause of a missing reply, by what was received since a time."""
        last_received_s = self._session.last_received_s
        if last_received_s is None or last_received_s < since_s:
            return "nothing else was received from the vehicle meanwhile: the link is down"
        if name in self._answered:
            return "the vehicle has answered for it before: the link loses messages, or it is busy"
        if self._answered:
            return (
                "the vehicle is received and has answered for other parameters: most likely this "
                "one does not exist in its firmware"
            )
        return (
            "the vehicle is received but has answered for no parameter yet: this one does not "
            "exist in its firmware, or our messages do not arrive"
        )

    def _on_value(self, message: Any, _t_s: float) -> None:
        if self._waiting is None or self._waiting[1].done():
            return
        name, future = self._waiting
        if message.param_id == name:
            self._answered.add(name)
            value = decode_parameter(
                message.param_value, message.param_type, bytewise=self._bytewise
            )
            future.set_result(_Answer(value, message.param_type))

    def _on_error(self, message: Any, _t_s: float) -> None:
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
