"""Fields of the few MAVLink messages that the guard needs, read from their bytes.

Layouts: message definitions of MAVLink common; payloads of version 2 come without their trailing
zeros. The frames are complete and their checksums verified.
"""

import math
import struct
from dataclasses import dataclass

from wil_campaign.vehicles.mavlink.framing import MavlinkFrame
from wil_campaign.worlds.frames import Vec3

HEARTBEAT = 0
SET_MODE = 11
PARAM_SET = 23
LOCAL_POSITION_NED = 32
COMMAND_INT = 75
COMMAND_LONG = 76
FILE_TRANSFER_PROTOCOL = 110
EXTENDED_SYS_STATE = 245

NAV_LOITER_UNLIM = 17
NAV_RETURN_TO_LAUNCH = 20
NAV_LAND = 21
NAV_TAKEOFF = 22
DO_ORBIT = 34
CONDITION_YAW = 115
DO_SET_MODE = 176
DO_CHANGE_SPEED = 178
DO_FLIGHTTERMINATION = 185
DO_REPOSITION = 192
DO_PAUSE_CONTINUE = 193
DO_PARACHUTE = 208
OVERRIDE_GOTO = 252
DO_SET_STANDARD_MODE = 262
MISSION_START = 300
COMPONENT_ARM_DISARM = 400

_ARMED = 0x80
_LANDED = {1: True, 2: False, 3: False, 4: False}
"""MAV_LANDED_STATE: on ground, in air, takeoff, landing; 0 is undefined."""
_FORCE = 21196
"""The magic number of MAV_CMD_COMPONENT_ARM_DISARM's param2."""

_heartbeat = struct.Struct("<IBBBBB")
_local_position = struct.Struct("<Iffffff")
_command = struct.Struct("<fff16xHB")


@dataclass(frozen=True, slots=True)
class HeartbeatFields:
    """The HEARTBEAT fields that the guard reads; critical: MAV_STATE_CRITICAL or worse."""

    custom_mode: int
    armed: bool
    critical: bool


@dataclass(frozen=True, slots=True)
class CommandFields:
    """The COMMAND_LONG or COMMAND_INT fields that the guard reads; system: target, 0 all."""

    number: int
    param1: float
    param2: float
    system: int = 0
    param3: float = 0.0

    @property
    def arms(self) -> bool:
        """Return whether the MAVLink command arms."""
        return self.number == COMPONENT_ARM_DISARM and self.param1 == 1.0

    @property
    def disarms(self) -> bool:
        """Return whether the MAVLink command disarms, forced or not."""
        return self.number == COMPONENT_ARM_DISARM and self.param1 != 1.0

    @property
    def cuts_motors(self) -> bool:
        """Return whether the MAVLink command stops the motors even in the air."""
        forced = self.disarms and round(self.param2) == _FORCE
        # NaN does not terminate (ArduCopter requires > 0.5), but is treated as if it did.
        return forced or (self.number == DO_FLIGHTTERMINATION and not self.param1 <= 0.5)


def _payload(frame: MavlinkFrame, size: int) -> bytes:
    """Return a MAVLink frame's payload, padded with zeros to a size."""
    start = 10 if frame.version == 2 else 6
    return frame.raw[start : start + min(size, frame.raw[1])].ljust(size, b"\0")


def read_heartbeat(frame: MavlinkFrame) -> HeartbeatFields:
    """Return the fields of a HEARTBEAT."""
    custom_mode, _, _, base_mode, status, _ = _heartbeat.unpack(_payload(frame, 9))
    # 5 critical, 6 emergency, 7 power-off, 8 termination
    return HeartbeatFields(custom_mode, bool(base_mode & _ARMED), status >= 5)


def read_landed(frame: MavlinkFrame) -> bool | None:
    """Return whether an EXTENDED_SYS_STATE says on the ground; None when unknown."""
    return _LANDED.get(_payload(frame, 2)[1])


def read_local_position(frame: MavlinkFrame) -> tuple[Vec3, Vec3] | None:
    """Return position and velocity of a LOCAL_POSITION_NED; None when not finite."""
    _, x, y, z, vx, vy, vz = _local_position.unpack(_payload(frame, 28))
    if not math.isfinite(x + y + z + vx + vy + vz):
        return None
    return (x, y, z), (vx, vy, vz)


def read_command(frame: MavlinkFrame) -> CommandFields:
    """Return the fields of a COMMAND_LONG or COMMAND_INT."""
    param1, param2, param3, number, system = _command.unpack(_payload(frame, 31))
    # round() of NaN raises; in commands NaN means that no value is given.
    return CommandFields(number, param1, param2 if math.isfinite(param2) else 0.0, system, param3)


def command_in_frame(frame: MavlinkFrame) -> CommandFields | None:
    """Return the command in a MAVLink frame; None when it has none."""
    return read_command(frame) if frame.message_id in {COMMAND_LONG, COMMAND_INT} else None


def read_set_mode(frame: MavlinkFrame) -> int:
    """Return the custom mode of a SET_MODE."""
    return int.from_bytes(_payload(frame, 4), "little")


def read_parameter(frame: MavlinkFrame) -> str:
    """Return the parameter's name in a PARAM_SET; what is no letter of it is a question mark."""
    name = _payload(frame, 22)[6:].split(b"\0")[0].decode("ascii", "replace")
    return "".join(one if one.isprintable() and one.isascii() else "?" for one in name)


def read_file_operation(frame: MavlinkFrame) -> int:
    """Return the opcode of a FILE_TRANSFER_PROTOCOL."""
    return _payload(frame, 7)[6]


def read_target(frame: MavlinkFrame, at: int) -> int:
    """Return the target system field of a MAVLink message, at this offset of its payload."""
    return _payload(frame, at + 1)[at]
