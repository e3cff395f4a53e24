"""`vehicles.<name>.sensors`: what a vehicle carries."""

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from worlds.camera import CameraMount, Intrinsics
from worlds.documents import KeyFaultError, Part
from worlds.frames import Pose, quat_from_euler

Pixels = Annotated[int, Field(ge=16, le=8192)]
Focal = Annotated[float, Field(gt=0, le=1e6)]
_FOCAL_KEYS = ("fx_px", "fy_px", "cx_px", "cy_px")


class MountPart(Part):
    """How a sensor sits on its body: metres forward, right and down of its centre, and angles.

    pitch_deg is positive upwards, yaw_deg to the right, roll_deg right side down.
    """

    forward_m: float = 0.0
    right_m: float = 0.0
    down_m: float = 0.0
    roll_deg: Annotated[float, Field(ge=-180, le=180)] = 0.0
    pitch_deg: Annotated[float, Field(ge=-90, le=90)] = 0.0
    yaw_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0

    def pose(self) -> Pose:
        """Return the sensor's pose in the body's FRD frame."""
        angles = (math.radians(a) for a in (self.roll_deg, self.pitch_deg, self.yaw_deg))
        return Pose((self.forward_m, self.right_m, self.down_m), quat_from_euler(*angles))


class CameraPart(Part):
    """A pinhole camera, its optics given by `fov_deg` (edge to edge, horizontal) or by `fx_px`.

    fy_px defaults to fx_px, cx_px and cy_px to the middle.
    """

    type: Literal["camera"]
    rate_hz: Annotated[float, Field(gt=0, le=1000)]
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
        if self.fov_deg is None and self.fx_px is None:
            raise ValueError("a camera needs fov_deg or fx_px")
        given = [key for key in _FOCAL_KEYS if getattr(self, key) is not None]
        if self.fov_deg is not None and given:
            raise KeyFaultError(given[0], "fov_deg says this already; give one of the two")
        return self

    def intrinsics(self) -> Intrinsics:
        """Return the pinhole."""
        if self.fov_deg is not None:
            fov_rad = math.radians(self.fov_deg)
            return Intrinsics.from_fov(self.width_px, self.height_px, fov_rad)
        fx_px = self.fx_px or 0.0
        return Intrinsics(
            width_px=self.width_px,
            height_px=self.height_px,
            fx_px=fx_px,
            fy_px=fx_px if self.fy_px is None else self.fy_px,
            cx_px=(self.width_px - 1) / 2.0 if self.cx_px is None else self.cx_px,
            cy_px=(self.height_px - 1) / 2.0 if self.cy_px is None else self.cy_px,
        )

    def camera_mount(self) -> CameraMount:
        """Return where it sits."""
        return CameraMount(self.mount.pose(), self.stabilized)


SensorPart = CameraPart
"""Any sensor; a union told apart by `type` as soon as there is a second one."""
