"""Definitions of px4_msgs as short as tests need them; the types' names and fields are PX4's."""

from pathlib import Path

VECTORS = "float32[3] position\nfloat32[3] velocity\n"
DEFINITIONS = {
    "TrajectorySetpoint": f"uint64 timestamp\n{VECTORS}float32 yaw\nfloat32 yawspeed\n",
    "OffboardControlMode": "uint64 timestamp\nbool position\nbool velocity\nbool attitude\n",
    "VehicleCommand": (
        "uint64 timestamp\nfloat32 param1\nfloat32 param2\nfloat32 param3\nuint32 command\n"
        "uint8 target_system\nuint8 target_component\nuint8 source_system\n"
        "uint16 source_component\n"
    ),
    "VehicleCommandAck": (
        "uint64 timestamp\nuint32 command\nuint8 result\nuint8 target_system\n"
        "uint16 target_component\n"
    ),
    "VehicleStatus": (
        "uint32 MESSAGE_VERSION = 1\nuint64 timestamp\nuint8 arming_state\nuint8 nav_state\n"
    ),
    "VehicleLocalPosition": (
        "uint64 timestamp\nbool xy_valid\nfloat32 x\nfloat32 y\nfloat32 z\nfloat32 vz\n"
        "float32 heading\nfloat32 vxy_max\n"
    ),
    "VehicleOdometry": f"uint64 timestamp\nuint8 pose_frame\n{VECTORS}float32[4] q\n",
}


def write_definitions(folder: Path) -> Path:
    """Write them as the repository px4_msgs has them; return its folder."""
    inner = folder / "px4_msgs" / "msg"
    inner.mkdir(parents=True)
    for name, text in DEFINITIONS.items():
        (inner / f"{name}.msg").write_text(text, "utf-8")
    return inner.parent
