"""The types of px4_msgs that a run uses, by the user's own definitions: releases of PX4 differ."""

from collections.abc import Mapping
from pathlib import Path

from wil_campaign.foundation.files.documents import KeyFaultError
from wil_campaign.plugins.ros2.messages.ros_messages import TRAJECTORY_SETPOINT
from wil_campaign.plugins.ros2.messages.ros_types import BadDefinitionError, RosTypes
from wil_campaign.plugins.ros2.messages.topics import OutTopic

OFFBOARD_MODE = "px4_msgs/msg/OffboardControlMode"
COMMAND = "px4_msgs/msg/VehicleCommand"
ACKNOWLEDGEMENT = "px4_msgs/msg/VehicleCommandAck"
STATUS = "px4_msgs/msg/VehicleStatus"
LOCAL_POSITION = "px4_msgs/msg/VehicleLocalPosition"
ODOMETRY = "px4_msgs/msg/VehicleOdometry"

MODE_TOPIC, COMMAND_TOPIC = "/fmu/in/offboard_control_mode", "/fmu/in/vehicle_command"
STATUS_TOPIC, ACKNOWLEDGEMENT_TOPIC = "/fmu/out/vehicle_status", "/fmu/out/vehicle_command_ack"
POSITION_TOPIC, ODOMETRY_TOPIC = "/fmu/out/vehicle_local_position", "/fmu/out/vehicle_odometry"
PX4_SETPOINTS: Mapping[str, str] = {"/fmu/in/trajectory_setpoint": TRAJECTORY_SETPOINT}
PX4_WORDS: Mapping[str, str] = {MODE_TOPIC: OFFBOARD_MODE, COMMAND_TOPIC: COMMAND}
PX4_OUT = tuple(
    # As PX4 has them; those of volatile and best effort hear them, too.
    OutTopic(name, kind, "latched")
    for name, kind in (
        (STATUS_TOPIC, STATUS),
        (POSITION_TOPIC, LOCAL_POSITION),
        (ODOMETRY_TOPIC, ODOMETRY),
        (ACKNOWLEDGEMENT_TOPIC, ACKNOWLEDGEMENT),
    )
)
_TYPES = (*PX4_SETPOINTS.values(), *PX4_WORDS.values(), *(out_topic.type for out_topic in PX4_OUT))
_VERSION = "MESSAGE_VERSION"
_READ: Mapping[str, tuple[str, ...]] = {
    TRAJECTORY_SETPOINT: ("timestamp", "position", "velocity", "yaw", "yawspeed"),
    OFFBOARD_MODE: ("position", "velocity"),
    COMMAND: (
        *("timestamp", "command", "param1", "param2", "param3"),
        *("source_system", "source_component"),
    ),
}
"""Fields that are read, of any release that is supported."""


def px4_types(distribution: str, folder: Path) -> RosTypes:
    """Return the types of a distribution and those of px4_msgs. Raises KeyFaultError."""
    try:
        types = RosTypes(distribution, px4_definitions(folder))
    except (BadDefinitionError, OSError, UnicodeDecodeError) as error:
        raise KeyFaultError("px4_msgs", str(error)) from error
    missing = [
        f"{name.rpartition('/')[2]}.{field}"
        for name, fields in _READ.items()
        for field in fields
        if not types.has_field(name, field)
    ]
    if missing:
        raise KeyFaultError(
            "px4_msgs", f"these definitions lack {', '.join(missing)}: PX4 has them from 1.14 on"
        )
    return types


def px4_definitions(folder: Path) -> dict[str, str]:
    """Return the texts of the types by name. folder: of px4_msgs, or its `msg`.

    Raises KeyFaultError for a file that is missing.
    """
    inner = folder / "msg"
    found = inner if inner.is_dir() else folder
    files = {name: found / f"{name.rpartition('/')[2]}.msg" for name in _TYPES}
    if missing := [file.name for file in files.values() if not file.is_file()]:
        raise KeyFaultError(
            "px4_msgs",
            f"there is no {', '.join(missing)} in '{found}': name the folder of px4_msgs, of the "
            "release that the node was built with",
        )
    return {name: file.read_text("utf-8") for name, file in files.items()}


def px4_names(types: RosTypes) -> dict[str, str]:
    """Return PX4's names of the topics by those here: a message with a version has it in them."""
    kinds = {
        **PX4_SETPOINTS,
        **PX4_WORDS,
        **{out_topic.name: out_topic.type for out_topic in PX4_OUT},
    }
    versions = {name: types.constant(kind, _VERSION) for name, kind in kinds.items()}
    return {name: f"{name}_v{version}" if version else name for name, version in versions.items()}
