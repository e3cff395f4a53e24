"""The MAVLink parameter service: lists, reads and sets parameters."""

import math
import struct
import zlib
from collections import deque
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.autopilot.flight.parameter_table import ParameterTable
from wil_campaign.vehicles.embedded.autopilot.services.command_registry import on_message
from wil_campaign.vehicles.embedded.autopilot.services.outbox import INFO, Outbox

NO_INDEX = 65535
"""ArduPilot's index of a parameter that was not requested by index."""
HASH_NAME = "_HASH_CHECK"
"""PX4's pseudo-parameter that tells a ground station whether it already has all values."""
_NO_BITS = 0xFFFFFFFF


class ParameterService:
    """Serves PARAM_REQUEST_LIST, PARAM_REQUEST_READ and PARAM_SET.

    strict: as PX4, which begins a list with the hash of all values, refuses a PARAM_SET of the
    wrong type and sends the parameter's index in its reply; otherwise as ArduPilot. That nothing
    acts on a parameter that is set, a STATUSTEXT says once.
    """

    _PER_TURN = 8
    """Number of parameters of a list that are sent per turn of 20 ms, to not flood a radio."""

    def __init__(self, parameters: ParameterTable, outbox: Outbox, *, strict: bool) -> None:
        self._parameters = parameters
        self._outbox = outbox
        self._strict = strict
        self._queue: deque[str] = deque()
        self._announced: set[str] = set()

    @on_message("PARAM_REQUEST_LIST")
    def _on_list(self, _: Any) -> None:
        """Begin to send all parameters; PX4 sends their hash first."""
        self._queue = deque([HASH_NAME] if self._strict else [])
        self._queue.extend(self._parameters)

    def turn(self) -> None:
        """Send the next few parameters of a list in progress."""
        if self._queue:
            for _ in range(min(self._PER_TURN, len(self._queue))):
                self._outbox.send(self._value(self._queue.popleft(), indexed=True))

    @on_message("PARAM_REQUEST_READ")
    def _on_read(self, message: Any) -> None:
        """Send the parameter; ArduPilot sends none for unknown names."""
        index = message.param_index
        name = self._parameters.name_at(index) if index >= 0 else message.param_id
        if self._strict and name == HASH_NAME:
            self._outbox.send(self._hash())
        elif name is None or name not in self._parameters:
            self._refuse(message, index)
        else:
            self._outbox.send(self._value(name, indexed=self._strict or index >= 0))

    @on_message("PARAM_SET")
    def _on_set(self, message: Any) -> None:
        self._set(message)
        name = message.param_id
        is_new = name in self._parameters and name not in self._announced
        if is_new and self._parameters.is_in_vain(name):
            self._announced.add(name)
            self._outbox.send_text(INFO, f"{name} has no effect in this emulation")

    def _set(self, message: Any) -> None:
        """Set a parameter and send the present value, or nothing."""
        name = message.param_id
        parameters = self._parameters
        if self._strict and name == HASH_NAME:
            # A ground station that already has all values stops the list this way.
            self._queue.clear()
            return
        if name not in parameters:
            self._refuse(message, -1)
            return
        if not self._strict and not math.isfinite(message.param_value):
            return
        if not self._strict or message.param_type == parameters.kind(name):
            value = parameters.from_wire(message.param_type, message.param_value)
            if math.isfinite(value):
                parameters.set(name, value)
        self._outbox.send(self._value(name, indexed=self._strict))

    def _refuse(self, message: Any, index: int) -> None:
        """Answer that there is no such parameter; ArduPilot does not."""
        if not self._strict:
            return
        peer = (message.get_srcSystem(), message.get_srcComponent())
        unknown = mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST
        name = message.param_id.encode(errors="replace")[:16]
        self._outbox.send(mavlink.MAVLink_param_error_message(*peer, name, index, unknown))

    def _value(self, name: str, *, indexed: bool) -> Any:
        if name == HASH_NAME:
            return self._hash()
        parameters = self._parameters
        return mavlink.MAVLink_param_value_message(
            name.encode(),
            parameters.to_wire(name),
            parameters.kind(name),
            len(parameters),
            parameters.index(name) if indexed else NO_INDEX,
        )

    def _hash(self) -> Any:
        """Return PX4's CRC-32 over names and values, in their order; neither end inverted."""
        parameters, crc = self._parameters, _NO_BITS
        for name in parameters:
            whole, value = parameters.is_whole(name), parameters[name]
            bits = struct.pack("<i", int(value)) if whole else struct.pack("<f", value)
            crc = zlib.crc32(name.encode() + bits, crc)
        (on_wire,) = struct.unpack("<f", struct.pack("<I", crc ^ _NO_BITS))
        kind = mavlink.MAV_PARAM_TYPE_UINT32
        return mavlink.MAVLink_param_value_message(
            HASH_NAME.encode(), on_wire, kind, len(parameters), NO_INDEX
        )
