"""The stable API for users' files: autonomies, steps of recipes, oracles, detectors.

Names may be added; none is removed or changes its meaning without an entry in the changelog. Other
modules are internal and may change. Coordinates are north-east-down metres of the world's frame,
angles radians, times seconds of the run clock, quaternions wxyz from body to NED, images BGR.
"""

from typing import TYPE_CHECKING

from wil_campaign import first_used
from wil_campaign.recipes.model.registry import SidedParameters, StepParameters, step
from wil_campaign.recipes.working import CannotMixError, Masked
from wil_campaign.safety.oracles.limit_oracle import LimitOracle
from wil_campaign.safety.oracles.oracle import Windowed, oracle
from wil_campaign.vehicles.autonomy import (
    Autonomy,
    AutonomyFactory,
    Command,
    PerceivesRaw,
    Telemetry,
)
from wil_campaign.vehicles.perception.blobs import Blob, BlobFinder, Borders, Box, Opening
from wil_campaign.vehicles.perception.hsv import NAMED_COLORS, HsvMask, HsvRange
from wil_campaign.vehicles.poses.pose_history import PoseAt, PoseHistory
from wil_campaign.vehicles.readings import (
    CameraReading,
    DepthReading,
    GpsReading,
    ImuReading,
    LidarPointsReading,
    LidarScanReading,
    MicrophoneReading,
    NumbersReading,
    PoseReading,
    RangefinderReading,
    Reading,
)
from wil_campaign.vehicles.sensors.sensor_spec import (
    MountedOptions,
    SensorOptions,
    SensorSite,
    SensorSpec,
)
from wil_campaign.vehicles.sensors.timing import Timing
from wil_campaign.vehicles.sensors.truth import Truth
from wil_campaign.vehicles.setpoints import PositionSetpoint, Setpoint, VelocitySetpoint
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import (
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

if TYPE_CHECKING:
    from wil_campaign.plugins.detector.detector import Detection, DetectorError, OnnxDetector
    from wil_campaign.plugins.detector.shipped_detector import shipped_detector

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
    "LimitOracle",
    "Masked",
    "MicrophoneReading",
    "MountedOptions",
    "NumbersReading",
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
    "SensorOptions",
    "SensorSite",
    "SensorSpec",
    "Setpoint",
    "SidedParameters",
    "StepParameters",
    "Telemetry",
    "Timing",
    "Truth",
    "Vec3",
    "VelocitySetpoint",
    "Windowed",
    "add",
    "euler_from_quat",
    "norm",
    "oracle",
    "quat_from_euler",
    "rotate",
    "scale",
    "shipped_detector",
    "step",
    "subtract",
    "wrap_pi",
]

_MODULES = {
    "plugins.detector.detector": ("Detection", "DetectorError", "OnnxDetector"),
    "plugins.detector.shipped_detector": ("shipped_detector",),
}
"""Where those of the names above are that only some files use."""


def __getattr__(name: str) -> object:
    """Return a name of a plugin, imported at its first use."""
    found = globals()[name] = first_used(name, _MODULES, __name__)
    return found
