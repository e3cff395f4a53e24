"""Sensors of a vehicle as a run needs them: frozen, resolved, one class for each type."""

from dataclasses import dataclass
from typing import ClassVar

from campaigns.values.external_setups import SourceSetup
from vehicles.sensors.lidar import GridPattern, ScanPattern
from worlds.camera import CameraMount, Intrinsics
from worlds.frames import AT_ORIGIN, Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSetup:
    """A camera of a vehicle; its intrinsics may carry a distortion. source: None: rendered."""

    kind: ClassVar[str] = "camera"

    name: str
    rate_hz: float
    intrinsics: Intrinsics
    mount: CameraMount
    source: SourceSetup | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthSetup:
    """A depth camera of a vehicle."""

    kind: ClassVar[str] = "depth"

    name: str
    rate_hz: float
    intrinsics: Intrinsics
    mount: CameraMount


@dataclass(frozen=True, slots=True, kw_only=True)
class Reach:
    """From where to where a ranging sensor sees, in metres; None: what its profile says."""

    min_m: float | None = None
    max_m: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarSetup:
    """A 2-D lidar. mount: its pose in the body's FRD frame."""

    kind: ClassVar[str] = "lidar"

    name: str
    rate_hz: float
    pattern: ScanPattern
    reach: Reach = Reach()
    mount: Pose = AT_ORIGIN


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarPointsSetup:
    """A 3-D lidar. mount: its pose in the body's FRD frame."""

    kind: ClassVar[str] = "lidar_points"

    name: str
    rate_hz: float
    pattern: GridPattern
    reach: Reach = Reach()
    mount: Pose = AT_ORIGIN


@dataclass(frozen=True, slots=True, kw_only=True)
class RangefinderSetup:
    """A single beam. half_angle_rad: of its cone. mount: its pose in the body's FRD frame."""

    kind: ClassVar[str] = "rangefinder"

    name: str
    rate_hz: float
    half_angle_rad: float
    mount: Pose
    reach: Reach = Reach()


@dataclass(frozen=True, slots=True, kw_only=True)
class GpsSetup:
    """A satellite receiver in the body's origin."""

    kind: ClassVar[str] = "gps"

    name: str
    rate_hz: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuSetup:
    """An IMU in the body's origin."""

    kind: ClassVar[str] = "imu"

    name: str
    rate_hz: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseSetup:
    """Motion capture of the vehicle. rate_hz: at most; None: as fast as it comes."""

    kind: ClassVar[str] = "pose"

    name: str
    rate_hz: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MicrophoneSetup:
    """A microphone on the body. block_samples: of one reading."""

    kind: ClassVar[str] = "microphone"

    name: str
    sample_rate_hz: int
    block_samples: int

    @property
    def rate_hz(self) -> float:
        """Return how many blocks come per second."""
        return self.sample_rate_hz / self.block_samples


RangingSetup = LidarSetup | LidarPointsSetup | RangefinderSetup
SensorSetup = (
    CameraSetup | DepthSetup | RangingSetup | GpsSetup | ImuSetup | PoseSetup | MicrophoneSetup
)
