"""`vehicles.<name>.sensors`: the sensors of a vehicle."""

import math
from dataclasses import replace
from functools import reduce
from operator import or_
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, create_model, model_validator

from wil_campaign.campaigns.schema.sources import CarriedPart, SourcedPart, SourcePart
from wil_campaign.campaigns.values.sensor_setups import CameraSetup, DepthSetup
from wil_campaign.foundation.files.documents import KeyFaultError, LaterType
from wil_campaign.hooks import sensor_types
from wil_campaign.installed_plugins import absent_additions
from wil_campaign.vehicles.readings.kinds import sensor_specs
from wil_campaign.vehicles.sensors.lens import lens_fault
from wil_campaign.vehicles.sensors.sensor_spec import MountPart, SensorSpec
from wil_campaign.worlds.camera import LEAST_FOV_DEG, CameraMount, Intrinsics

Pixels = Annotated[int, Field(ge=16, le=8192)]
Rate = Annotated[float, Field(gt=0, le=1000)]
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
    fov_deg: Annotated[float, Field(ge=LEAST_FOV_DEG, lt=180)] | None = None
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
    optics, and with mounting and latency where they were measured.
    """

    type: Literal["camera"]
    distortion: Distortion = Field(default_factory=list)
    source: SourcePart | None = None
    calibration: str | None = None

    @model_validator(mode="after")
    def _require_possible_lens(self) -> Self:
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


class DepthPart(ImagePart, SourcedPart):
    """A depth camera sensor: stereo or time of flight.

    source: where its readings come from; by default they are rendered.
    """

    type: Literal["depth"]

    def setup(self, name: str) -> DepthSetup:
        """Return the setup of the depth camera sensor."""
        return DepthSetup(
            name=name, rate_hz=self.rate_hz, intrinsics=self.pinhole(), mount=self.camera_mount()
        )


_IMAGES: dict[str, type[CarriedPart]] = {"camera": CameraPart, "depth": DepthPart}
"""The types whose keys are here; those of the others are the options of their files."""


def sensor_parts() -> tuple[type[CarriedPart], ...]:
    """Return the model of each type of sensors, those of plugins last."""
    return tuple(_IMAGES.get(name) or _part_of(spec) for name, spec in sensor_specs().items())


def _part_of(spec: SensorSpec) -> type[SourcedPart]:
    """Return the model of a type of sensors: its options, with `type` and `source`."""
    kind: Any = Literal[spec.name]
    name = f"{spec.options.__name__.removesuffix('Options')}Part"
    bases: Any = (spec.options, SourcedPart)
    doc = spec.options.__doc__
    part: type[SourcedPart] = create_model(name, __base__=bases, __doc__=doc, type=(kind, ...))
    return part


def _any_part() -> Any:
    either: Any = reduce(or_, sensor_parts())
    one = Annotated[either, Field(discriminator="type")]
    return Annotated[one, BeforeValidator(_require_installed)]


def _require_installed(given: object) -> object:
    """Return a sensor's keys; raises KeyFaultError for a type whose plugin is absent."""
    named = given.get("type") if isinstance(given, dict) else None
    if why := absent_additions(sensor_types).get(str(named)):
        raise KeyFaultError("type", why)
    return given


SensorPart = Annotated[CarriedPart, LaterType(_any_part)]
"""Any sensor; `type` selects the model."""
