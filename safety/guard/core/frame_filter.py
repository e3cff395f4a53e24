"""Classifies MAVLink frames: which ones the guard forwards, and which ones take control."""

from wil_campaign.vehicles.mavlink.fields import (
    DO_ORBIT,
    DO_PARACHUTE,
    DO_PAUSE_CONTINUE,
    DO_REPOSITION,
    DO_SET_MODE,
    DO_SET_STANDARD_MODE,
    FILE_TRANSFER_PROTOCOL,
    MISSION_START,
    NAV_LAND,
    NAV_LOITER_UNLIM,
    NAV_RETURN_TO_LAUNCH,
    NAV_TAKEOFF,
    OVERRIDE_GOTO,
    PARAM_SET,
    SET_MODE,
    command_in_frame,
    read_file_operation,
    read_parameter,
    read_target,
)
from wil_campaign.vehicles.mavlink.framing import MavlinkFrame
from wil_campaign.vehicles.mavlink.names import command_name, message_name

_CONFIGURATION = frozenset(
    {
        PARAM_SET,
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
        NAV_LOITER_UNLIM,
        NAV_RETURN_TO_LAUNCH,
        NAV_LAND,
        NAV_TAKEOFF,
        DO_ORBIT,
        DO_SET_MODE,
        DO_REPOSITION,
        DO_PAUSE_CONTINUE,
        DO_PARACHUTE,
        OVERRIDE_GOTO,
        DO_SET_STANDARD_MODE,
        MISSION_START,
    }
)
"""Commands by which a pilot takes over: of modes, of where to fly, and of the last resort."""
_READING_COMMANDS = _HARMLESS_COMMANDS | {410, 521, 522, 525, 527}
"""And the requests for the home position and for a camera's information, settings and state."""
_READING = frozenset(
    {
        123,  # GPS_INJECT_DATA
        233,  # GPS_RTCM_DATA
        320,  # PARAM_EXT_REQUEST_READ
        321,  # PARAM_EXT_REQUEST_LIST
        12900,  # OPEN_DRONE_ID_BASIC_ID
        12902,  # OPEN_DRONE_ID_AUTHENTICATION
        12903,  # OPEN_DRONE_ID_SELF_ID
        12904,  # OPEN_DRONE_ID_SYSTEM
        12905,  # OPEN_DRONE_ID_OPERATOR_ID
        12915,  # OPEN_DRONE_ID_MESSAGE_PACK
        12919,  # OPEN_DRONE_ID_SYSTEM_UPDATE
    }
)
"""What a ground station may send beside what is harmless: corrections of a GPS base station, which
a receiver checks against its satellites, and what the law has a vehicle broadcast."""
_FILE_READING = frozenset({0, 1, 2, 3, 4, 5, 14, 15})
"""Opcodes of MAVLink FTP that change no file."""
_STICKS_AT = {69: 10, 70: 16}
"""The offset of the target system in MANUAL_CONTROL and RC_CHANNELS_OVERRIDE."""


_TARGET_AT = {SET_MODE: 4, 82: 36, 84: 50, 86: 50}
"""The offset of the target system in the payloads of SET_MODE and of setpoints."""


def is_harmless_frame(frame: MavlinkFrame, *, configures: bool) -> bool:
    """Return whether a frame is forwarded while the orchestrator is not in command.

    configures: whether parameters, fence and mission may be set too: they are restored after a
    flight.
    """
    if frame.message_id in _CONFIGURATION:
        return configures
    command = command_in_frame(frame)
    if command is not None:
        return command.number in _HARMLESS_COMMANDS
    return frame.message_id in _HARMLESS or frame.message_id in ESTIMATES


def is_read_only_frame(frame: MavlinkFrame) -> bool:
    """Return whether a ground station's frame changes nothing that a flight was checked with.

    What is not known to read only is taken to change something.
    """
    command = command_in_frame(frame)
    if command is not None:
        return command.number in _READING_COMMANDS
    if frame.message_id == FILE_TRANSFER_PROTOCOL:
        return read_file_operation(frame) in _FILE_READING
    return frame.message_id in _HARMLESS or frame.message_id in _READING


def is_stick_input(frame: MavlinkFrame, system: int) -> bool:
    """Return whether a ground station's frame holds stick positions for the vehicle `system`."""
    at = _STICKS_AT.get(frame.message_id)
    return at is not None and read_target(frame, at) in {0, system}


def is_control_frame(frame: MavlinkFrame, system: int) -> bool:
    """Return whether a ground station's frame takes control of the vehicle `system`."""
    at = _TARGET_AT.get(frame.message_id)
    if at is not None:
        return read_target(frame, at) in {0, system}
    command = command_in_frame(frame)
    if command is None or command.system not in {0, system}:
        return False
    return command.number in _CONTROL_COMMANDS or command.disarms or command.cuts_motors


def frame_name(frame: MavlinkFrame) -> str:
    """Return a frame's name in messages: its MAVLink message, its parameter, or its command."""
    if frame.message_id == PARAM_SET:
        return f"PARAM_SET of {read_parameter(frame)}"
    command = command_in_frame(frame)
    return message_name(frame.message_id) if command is None else command_name(command.number)
