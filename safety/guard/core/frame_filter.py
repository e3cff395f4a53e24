"""Classifies MAVLink frames: which ones the guard forwards, and which ones take control."""

from safety.guard.core.mavlink_fields import (
    COMMAND_INT,
    COMMAND_LONG,
    DO_PAUSE_CONTINUE,
    DO_REPOSITION,
    DO_SET_MODE,
    MISSION_START,
    NAV_LAND,
    NAV_RETURN_TO_LAUNCH,
    NAV_TAKEOFF,
    SET_MODE,
    Command,
    read_command,
    read_target,
)
from vehicles.mavlink.framing import Frame
from vehicles.mavlink.names import command_name, message_name

_CONFIGURATION = frozenset(
    {
        23,  # PARAM_SET
        44,  # MISSION_COUNT
        45,  # MISSION_CLEAR_ALL
        73,  # MISSION_ITEM_INT
    }
)
"""Messages that restore parameters, fence or mission after the flight."""
_HARMLESS = frozenset(
    {
        0,  # HEARTBEAT
        2,  # SYSTEM_TIME
        4,  # PING
        20,  # PARAM_REQUEST_READ
        21,  # PARAM_REQUEST_LIST
        40,  # MISSION_REQUEST
        43,  # MISSION_REQUEST_LIST
        47,  # MISSION_ACK
        51,  # MISSION_REQUEST_INT
        66,  # REQUEST_DATA_STREAM
        111,  # TIMESYNC
        117,  # LOG_REQUEST_LIST
        119,  # LOG_REQUEST_DATA
        122,  # LOG_REQUEST_END
    }
)
"""Messages that only read, or keep a link alive."""
ESTIMATES = frozenset(
    {
        102,  # VISION_POSITION_ESTIMATE
        132,  # DISTANCE_SENSOR
        138,  # ATT_POS_MOCAP
        331,  # ODOMETRY
    }
)
"""Inputs of the estimator: without them a vehicle that is being landed may be lost."""
_HARMLESS_COMMANDS = frozenset({510, 511, 512, 519, 520})
"""Message intervals, requests of a message, of the version and of the capabilities."""
_CONTROL_COMMANDS = frozenset(
    {
        NAV_RETURN_TO_LAUNCH,
        NAV_LAND,
        NAV_TAKEOFF,
        DO_SET_MODE,
        DO_REPOSITION,
        DO_PAUSE_CONTINUE,
        MISSION_START,
    }
)


_TARGET_AT = {SET_MODE: 4, 82: 36, 84: 50, 86: 50}
"""The offset of the target system in the payloads of SET_MODE and of setpoints."""


def command_of(frame: Frame) -> Command | None:
    """Return the command in a MAVLink frame; None when it has none."""
    return read_command(frame) if frame.message_id in {COMMAND_LONG, COMMAND_INT} else None


def is_harmless(frame: Frame, *, configures: bool) -> bool:
    """Return whether a frame is forwarded while the orchestrator is not in command.

    configures: whether parameters, fence and mission may be set too: they are restored after a
    flight.
    """
    if frame.message_id in _CONFIGURATION:
        return configures
    command = command_of(frame)
    if command is not None:
        return command.number in _HARMLESS_COMMANDS
    return frame.message_id in _HARMLESS or frame.message_id in ESTIMATES


def is_control(frame: Frame, system: int) -> bool:
    """Return whether a ground station's frame takes control of the vehicle `system`."""
    at = _TARGET_AT.get(frame.message_id)
    if at is not None:
        return read_target(frame, at) in {0, system}
    command = command_of(frame)
    if command is None or command.system not in {0, system}:
        return False
    return command.number in _CONTROL_COMMANDS or command.disarms or command.cuts_motors


def frame_name(frame: Frame) -> str:
    """Return a frame's name in messages: its MAVLink message, or its command."""
    command = command_of(frame)
    return message_name(frame.message_id) if command is None else command_name(command.number)
