"""Setups of a vehicle's sensors, one class for each type.

source: of external readings; None: readings are computed here.
"""

from dataclasses import dataclass
from typing import ClassVar

from wil_campaign.campaigns.values.external_setups import ReadingSourceSetup, SourceSetup
from wil_campaign.vehicles.sensors.lidar import GridPattern, ScanPattern
from wil_campaign.worlds.camera import CameraMount, Intrinsics
from wil_campaign.worlds.frames import AT_ORIGIN, Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSetup:
    """The setup of a vehicle's camera; intrinsics may be distorted. source: None: rendered."""

    kind: ClassVar[str] = "camera"

    name: str
    rate_hz: float
    intrinsics: Intrinsics
    mount: CameraMount
    source: SourceSetup | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthSetup:
    """The setup of a vehicle's depth camera."""

    kind: ClassVar[str] = "depth"

    name: str
    rate_hz: float
    intrinsics: Intrinsics
    mount: CameraMount


@dataclass(frozen=True, slots=True, kw_only=True)
class Reach:
    """Least and greatest range of a ranging sensor, metres; None: as in its profile."""

    min_m: float | None = None
    max_m: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarSetup:
    """The setup of a 2-D lidar. mount: its pose in the body's FRD frame."""

    kind: ClassVar[str] = "lidar"

    name: str
    rate_hz: float
    pattern: ScanPattern
    reach: Reach = Reach()
    mount: Pose = AT_ORIGIN
    source: ReadingSourceSetup | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarPointsSetup:
    """The setup of a 3-D lidar. mount: its pose in the body's FRD frame."""

    kind: ClassVar[str] = "lidar_points"

    name: str
    rate_hz: float
    pattern: GridPattern
    reach: Reach = Reach()
    mount: Pose = AT_ORIGIN
    source: ReadingSourceSetup | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RangefinderSetup:
    """The setup of a rangefinder. half_angle_rad: of its beam. mount: pose in the FRD frame."""

    kind: ClassVar[str] = "rangefinder"

    name: str
    rate_hz: float
    half_angle_rad: float
    mount: Pose
    reach: Reach = Reach()
    source: ReadingSourceSetup | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class GpsSetup:
    """The setup of a GPS receiver in the body's origin."""

    kind: ClassVar[str] = "gps"

    name: str
    rate_hz: float
    source: ReadingSourceSetup | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuSetup:
    """The setup of an IMU in the body's origin."""

    kind: ClassVar[str] = "imu"

    name: str
    rate_hz: float
    source: ReadingSourceSetup | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseSetup:
    """The setup of a pose sensor (motion capture). rate_hz: the highest; None: as it arrives."""

    kind: ClassVar[str] = "pose"

    name: str
    rate_hz: float | None = None
    source: ReadingSourceSetup | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MicrophoneSetup:
    """The setup of a microphone on the body. block_samples: of one reading."""

    kind: ClassVar[str] = "microphone"

    name: str
    sample_rate_hz: int
    block_samples: int
    source: ReadingSourceSetup | None = None

    @property
    def rate_hz(self) -> float:
        """Return the microphone's blocks per second."""
        return self.sample_rate_hz / self.block_samples


RangingSetup = LidarSetup | LidarPointsSetup | RangefinderSetup
SourcedSetup = RangingSetup | GpsSetup | ImuSetup | PoseSetup | MicrophoneSetup
"""The sensors that may have an external source of readings."""
SensorSetup = (
    CameraSetup | DepthSetup | RangingSetup | GpsSetup | ImuSetup | PoseSetup | MicrophoneSetup
)
