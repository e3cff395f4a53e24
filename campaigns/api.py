"""The stable API for users' files: autonomies, steps of recipes, detectors.

Names may be added; none is removed or changes its meaning without an entry in the changelog. Other
modules are internal and may change. Coordinates are north-east-down metres of the world's frame,
angles radians, times seconds of the run clock, quaternions wxyz from body to NED, images BGR.
"""

from recipes.working import CannotMixError, Masked
from vehicles.autonomy import Autonomy, AutonomyFactory, Command, PerceivesRaw, Telemetry
from vehicles.perception.blobs import Blob, BlobFinder, Borders, Box, Opening
from vehicles.perception.detector import Detection, DetectorError, OnnxDetector
from vehicles.perception.hsv import NAMED_COLORS, HsvMask, HsvRange
from vehicles.perception.shipped_detector import shipped_detector
from vehicles.poses.pose_history import PoseAt, PoseHistory
from vehicles.readings import (
    CameraReading,
    DepthReading,
    GpsReading,
    ImuReading,
    LidarPointsReading,
    LidarScanReading,
    MicrophoneReading,
    PoseReading,
    RangefinderReading,
    Reading,
)
from vehicles.setpoints import PositionSetpoint, Setpoint, VelocitySetpoint
from worlds.camera import Intrinsics
from worlds.frames import (
    Pose,
    Quat,
    Vec3,
    add,
    euler_from_quat,
    norm,
    quat_from_euler,
    rotate,
    scale,
    subtract,
    wrap_pi,
)

__all__ = [
    "NAMED_COLORS",
    "Autonomy",
    "AutonomyFactory",
    "Blob",
    "BlobFinder",
    "Borders",
    "Box",
    "CameraReading",
    "CannotMixError",
    "Command",
    "DepthReading",
    "Detection",
    "DetectorError",
    "GpsReading",
    "HsvMask",
    "HsvRange",
    "ImuReading",
    "Intrinsics",
    "LidarPointsReading",
    "LidarScanReading",
    "Masked",
    "MicrophoneReading",
    "OnnxDetector",
    "Opening",
    "PerceivesRaw",
    "Pose",
    "PoseAt",
    "PoseHistory",
    "PoseReading",
    "PositionSetpoint",
    "Quat",
    "RangefinderReading",
    "Reading",
    "Setpoint",
    "Telemetry",
    "Vec3",
    "VelocitySetpoint",
    "add",
    "euler_from_quat",
    "norm",
    "quat_from_euler",
    "rotate",
    "scale",
    "shipped_detector",
    "subtract",
    "wrap_pi",
]
