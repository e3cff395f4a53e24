"""`vehicles.<name>.sensors`: the sensors of a vehicle."""

import math
from dataclasses import replace
from typing import Annotated, ClassVar, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from wil_campaign.campaigns.schema.sources import CarriedPart, SourcedPart, SourcePart
from wil_campaign.campaigns.values.sensor_setups import (
    CameraSetup,
    DepthSetup,
    GpsSetup,
    ImuSetup,
    LidarPointsSetup,
    LidarSetup,
    MicrophoneSetup,
    PoseSetup,
    RangefinderSetup,
    Reach,
)
from wil_campaign.vehicles.sensors.lens import lens_fault
from wil_campaign.vehicles.sensors.lidar import GridPattern, ScanPattern
from wil_campaign.worlds.camera import CameraMount, Intrinsics
from wil_campaign.worlds.files.documents import KeyFaultError, Part
from wil_campaign.worlds.frames import Pose, quat_from_euler

Pixels = Annotated[int, Field(ge=16, le=8192)]
Rate = Annotated[float, Field(gt=0, le=1000)]
TruthRate = Annotated[float, Field(gt=0, le=250)]
"""The embedded vehicle's physics runs at 250 Hz: no truth is available in between."""
Metres = Annotated[float, Field(ge=0, le=10_000)]
Focal = Annotated[float, Field(gt=0, le=1e6)]
_FOCAL_KEYS = ("fx_px", "fy_px", "cx_px", "cy_px")
_DISTORTIONS = (0, 4, 5, 8, 12, 14)
"""Numbers of coefficients of OpenCV's lens models."""


def _as_opencv(given: list[float]) -> list[float]:
    """Refuse a camera sensor's distortion whose length no OpenCV model has."""
    if len(given) not in _DISTORTIONS:
        raise ValueError(
            f"has {len(given)} numbers; OpenCV's models have 4 (k1, k2, p1, p2), 5, 8, 12 or 14"
        )
    return given


Distortion = Annotated[list[float], AfterValidator(_as_opencv)]


class MountPart(Part):
    """A sensor's mount: metres forward, right and down of the body's centre, and angles.

    pitch_deg is positive upwards, yaw_deg to the right, roll_deg right side down.

    forward_m, right_m, down_m: from the body's centre to the sensor. roll_deg, pitch_deg, yaw_deg:
    turn of the sensor on the body, applied as yaw, then pitch, then roll.
    """

    forward_m: float = 0.0
    right_m: float = 0.0
    down_m: float = 0.0
    roll_deg: Annotated[float, Field(ge=-180, le=180)] = 0.0
    pitch_deg: Annotated[float, Field(ge=-90, le=90)] = 0.0
    yaw_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0

    def pose(self) -> Pose:
        """Return the sensor's mount as a pose in the body's FRD frame."""
        angles = (math.radians(a) for a in (self.roll_deg, self.pitch_deg, self.yaw_deg))
        return Pose((self.forward_m, self.right_m, self.down_m), quat_from_euler(*angles))


class ImagePart(CarriedPart):
    """A pinhole image sensor; optics by `fov_deg` (horizontal, edge to edge) or by `fx_px`.

    fy_px defaults to fx_px, cx_px and cy_px to the middle. distortion: OpenCV's k1, k2, p1, p2 and
    on (4, 5, 8, 12 or 14 numbers); none without.

    rate_hz: images in a second. width_px, height_px: size of an image, from 16 to 8192. fov_deg:
    horizontal field of view, from edge to edge. fx_px: focal length along the width. fy_px: focal
    length along the height. cx_px: principal point, from the left. cy_px: principal point, from the
    top. mount: position and direction on the body; by default forward. stabilized: whether a gimbal
    keeps roll and pitch level.
    """

    rate_hz: Rate
    width_px: Pixels
    height_px: Pixels
    fov_deg: Annotated[float, Field(gt=0, lt=180)] | None = None
    fx_px: Focal | None = None
    fy_px: Focal | None = None
    cx_px: float | None = None
    cy_px: float | None = None
    mount: MountPart = MountPart()
    stabilized: bool = False

    @model_validator(mode="after")
    def _one_kind_of_optics(self) -> Self:
        """Require either fov_deg or focal lengths of an image sensor."""
        if self.fov_deg is None and self.fx_px is None and self._needs_optics():
            raise ValueError("a camera needs fov_deg or fx_px")
        given = [key for key in _FOCAL_KEYS if getattr(self, key) is not None]
        if self.fov_deg is not None and given:
            raise KeyFaultError(given[0], "fov_deg determines this already; give one of the two")
        return self

    def _needs_optics(self) -> bool:
        """Return whether this image sensor must give its optics."""
        return True

    def pinhole(self, distortion: tuple[float, ...] = ()) -> Intrinsics:
        """Return the image sensor's camera model."""
        if self.fov_deg is not None:
            fov_rad = math.radians(self.fov_deg)
            plain = Intrinsics.from_fov(self.width_px, self.height_px, fov_rad)
            return replace(plain, distortion=distortion)
        fx_px = self.fx_px or 0.0
        return Intrinsics(
            width_px=self.width_px,
            height_px=self.height_px,
            fx_px=fx_px,
            fy_px=fx_px if self.fy_px is None else self.fy_px,
            cx_px=(self.width_px - 1) / 2.0 if self.cx_px is None else self.cx_px,
            cy_px=(self.height_px - 1) / 2.0 if self.cy_px is None else self.cy_px,
            distortion=distortion,
        )

    def camera_mount(self) -> CameraMount:
        """Return the image sensor's mount on the body."""
        return CameraMount(self.mount.pose(), self.stabilized)


class CameraPart(ImagePart):
    """A camera sensor. distortion: OpenCV's k1, k2, p1, p2, k3 and on; none without.

    source: where its images come from; by default they are rendered. calibration: file with its
    optics, and with mounting and latency where they were measured. type: the kind of sensor.
    """

    type: Literal["camera"]
    distortion: Distortion = Field(default_factory=list)
    source: SourcePart | None = None
    calibration: str | None = None

    @model_validator(mode="after")
    def _require_possible_lens(self) -> Self:
        """Refuse a camera sensor's distortion that no lens can have."""
        fault = lens_fault(self.intrinsics()) if self.distortion and self._has_optics() else ""
        if fault:
            raise KeyFaultError("distortion", fault)
        return self

    @model_validator(mode="after")
    def _require_single_lens(self) -> Self:
        """Refuse a camera sensor that gives optics beside a calibration."""
        for key in ("fov_deg", *_FOCAL_KEYS, "distortion") if self.calibration is not None else ():
            if key in self.model_fields_set:
                raise KeyFaultError(
                    key, "the calibration determines this already; give one of the two"
                )
        return self

    def _has_optics(self) -> bool:
        """Return whether the camera sensor gives its optics itself."""
        return self.fov_deg is not None or self.fx_px is not None

    def _needs_optics(self) -> bool:
        """Return whether the camera sensor must give optics: no calibration does."""
        return self.calibration is None

    def intrinsics(self) -> Intrinsics:
        """Return the camera sensor's model with its distortion."""
        return self.pinhole(tuple(self.distortion))

    def setup(self, name: str) -> CameraSetup:
        """Return the setup of the camera sensor."""
        return CameraSetup(
            name=name, rate_hz=self.rate_hz, intrinsics=self.intrinsics(), mount=self.camera_mount()
        )


class DepthPart(ImagePart):
    """A depth camera sensor: stereo or time of flight.

    type: the kind of sensor.
    """

    type: Literal["depth"]

    def setup(self, name: str) -> DepthSetup:
        """Return the setup of the depth camera sensor."""
        return DepthSetup(
            name=name, rate_hz=self.rate_hz, intrinsics=self.pinhole(), mount=self.camera_mount()
        )


class RangingPart(SourcedPart):
    """The keys of every ranging sensor; its range defaults to that of the profile's sensor.

    range_min_m: the least measured distance. range_max_m: the greatest measured distance.
    """

    range_min_m: Metres | None = None
    range_max_m: Annotated[float, Field(gt=0, le=10_000)] | None = None
    mount: MountPart = MountPart()

    @model_validator(mode="after")
    def _require_order(self) -> Self:
        """Refuse a ranging sensor whose range_max_m is not above range_min_m."""
        low, high = self.range_min_m, self.range_max_m
        if low is not None and high is not None and low >= high:
            raise KeyFaultError("range_max_m", f"must be more than range_min_m, {low:g}")
        return self

    def reach(self) -> Reach:
        """Return the least and greatest range of a ranging sensor."""
        return Reach(min_m=self.range_min_m, max_m=self.range_max_m)


class LidarPart(RangingPart):
    """A 2-D lidar sensor: `beams` spread evenly over `fov_deg`, its middle forward.

    type: the kind of sensor. rate_hz: scans in a second. beams: their number in one scan. fov_deg:
    from the first beam to the last; 360 is a full turn.
    """

    type: Literal["lidar"]
    rate_hz: TruthRate = 10.0
    beams: Annotated[int, Field(ge=1, le=100_000)] = 400
    fov_deg: Annotated[float, Field(gt=0, le=360)] = 360.0

    def setup(self, name: str) -> LidarSetup:
        """Return the setup of the 2-D lidar sensor."""
        fov_rad, gaps = math.radians(self.fov_deg), self.beams - (self.fov_deg < 360.0)
        pattern = ScanPattern(self.beams, -fov_rad / 2.0, fov_rad / max(1, gaps))
        if self.beams == 1:
            pattern = ScanPattern(1, 0.0, fov_rad)
        return LidarSetup(
            name=name,
            rate_hz=self.rate_hz,
            pattern=pattern,
            reach=self.reach(),
            mount=self.mount.pose(),
        )


class LidarPointsPart(RangingPart):
    """A 3-D lidar sensor: a full turn of `columns`, each of `rings` between two elevations.

    type: the kind of sensor. rate_hz: turns in a second. columns: number of directions of one turn.
    rings: number of beams of each column, by elevation. lowest_deg: elevation of the
    lowest ring, positive upwards. highest_deg: elevation of the highest ring, positive upwards.
    """

    type: Literal["lidar_points"]
    rate_hz: TruthRate = 20.0
    columns: Annotated[int, Field(ge=1, le=10_000)] = 900
    rings: Annotated[int, Field(ge=1, le=256)] = 16
    lowest_deg: Annotated[float, Field(ge=-90, le=90)] = -15.0
    highest_deg: Annotated[float, Field(ge=-90, le=90)] = 15.0

    @model_validator(mode="after")
    def _upwards(self) -> Self:
        """Refuse a 3-D lidar sensor whose highest_deg is below lowest_deg."""
        if self.highest_deg < self.lowest_deg:
            raise KeyFaultError("highest_deg", f"must be at least lowest_deg, {self.lowest_deg:g}")
        return self

    def setup(self, name: str) -> LidarPointsSetup:
        """Return the setup of the 3-D lidar sensor."""
        low_rad, high_rad = math.radians(self.lowest_deg), math.radians(self.highest_deg)
        return LidarPointsSetup(
            name=name,
            rate_hz=self.rate_hz,
            pattern=GridPattern(self.columns, self.rings, low_rad, high_rad),
            reach=self.reach(),
            mount=self.mount.pose(),
        )


class RangefinderPart(RangingPart):
    """A rangefinder sensor: one beam, `beam_deg` wide; looks down unless a mount is given.

    type: the kind of sensor. rate_hz: measurements in a second. beam_deg: full width of the beam.
    """

    type: Literal["rangefinder"]
    rate_hz: TruthRate = 50.0
    beam_deg: Annotated[float, Field(ge=0, le=90)] = 3.6
    mount: MountPart = MountPart(pitch_deg=-90.0)

    def setup(self, name: str) -> RangefinderSetup:
        """Return the setup of the rangefinder sensor."""
        return RangefinderSetup(
            name=name,
            rate_hz=self.rate_hz,
            half_angle_rad=math.radians(self.beam_deg / 2.0),
            reach=self.reach(),
            mount=self.mount.pose(),
        )


class GpsPart(SourcedPart):
    """A GPS receiver among a vehicle's sensors.

    type: the kind of sensor. rate_hz: fixes in a second.
    """

    type: Literal["gps"]
    rate_hz: TruthRate = 5.0

    def setup(self, name: str) -> GpsSetup:
        """Return the setup of the GPS sensor."""
        return GpsSetup(name=name, rate_hz=self.rate_hz)


class ImuPart(SourcedPart):
    """An IMU among a vehicle's sensors: accelerometer and gyroscope.

    type: the kind of sensor. rate_hz: samples in a second.
    """

    embedded_only: ClassVar[bool] = True
    type: Literal["imu"]
    rate_hz: TruthRate = 200.0

    def setup(self, name: str) -> ImuSetup:
        """Return the setup of the IMU sensor."""
        return ImuSetup(name=name, rate_hz=self.rate_hz)


class PosePart(SourcedPart):
    """A pose sensor: motion capture. rate_hz: highest rate; by default the profile's.

    type: the kind of sensor.
    """

    embedded_only: ClassVar[bool] = True
    type: Literal["pose"]
    rate_hz: TruthRate | None = None

    def setup(self, name: str) -> PoseSetup:
        """Return the setup of the pose sensor."""
        return PoseSetup(name=name, rate_hz=self.rate_hz)


class MicrophonePart(SourcedPart):
    """A microphone sensor that delivers blocks of samples.

    type: the kind of sensor. sample_rate_hz: samples in a second. block_samples: samples of each
    reading.
    """

    embedded_only: ClassVar[bool] = True
    type: Literal["microphone"]
    sample_rate_hz: Annotated[int, Field(ge=1000, le=192_000)] = 16_000
    block_samples: Annotated[int, Field(ge=16, le=65_536)] = 512

    @model_validator(mode="after")
    def _limit_rate(self) -> Self:
        """Refuse a microphone sensor of more than 250 blocks per second."""
        blocks_hz = self.sample_rate_hz / self.block_samples
        if blocks_hz > 250.0:
            raise KeyFaultError("block_samples", f"gives {blocks_hz:g} blocks/s; at most 250")
        return self

    def setup(self, name: str) -> MicrophoneSetup:
        """Return the setup of the microphone sensor."""
        return MicrophoneSetup(
            name=name, sample_rate_hz=self.sample_rate_hz, block_samples=self.block_samples
        )


SensorPart = Annotated[
    CameraPart
    | DepthPart
    | LidarPart
    | LidarPointsPart
    | RangefinderPart
    | GpsPart
    | PosePart
    | ImuPart
    | MicrophonePart,
    Field(discriminator="type"),
]
"""Any sensor; `type` selects the model."""
