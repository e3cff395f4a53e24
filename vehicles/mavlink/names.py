"""MAVLink's names for its enum values, commands and messages, for log and error texts."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink


def enum_name(enum: str, value: int) -> str:
    """Return the name of a MAVLink enum's entry ("MAV_RESULT_DENIED"), or "MAV_RESULT 77"."""
    entry = mavlink.enums[enum].get(value)
    return entry.name if entry is not None else f"{enum} {value}"


def command_name(command: int) -> str:
    """Return the name of a MAVLink command ("MAV_CMD_NAV_TAKEOFF")."""
    return enum_name("MAV_CMD", command)


def result_name(result: int) -> str:
    """Return the name of a MAVLink command's result ("MAV_RESULT_DENIED")."""
    return enum_name("MAV_RESULT", result)


def message_name(message_id: int) -> str:
    """Return the name of a MAVLink message ("LOCAL_POSITION_NED")."""
    kind = mavlink.mavlink_map.get(message_id)
    return kind.msgname if kind is not None else f"message {message_id}"


def message_number(name: str) -> int:
    """Return the id of a MAVLink message by its name ("LOCAL_POSITION_NED")."""
    number: int = getattr(mavlink, f"MAVLINK_MSG_ID_{name}")
    return number
