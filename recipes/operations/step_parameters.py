"""Parts that several steps' parameters share: rotations, cameras, ranges."""

import math
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from wil_campaign.foundation.files.documents import KeyFaultError, Part
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import (
    Quat,
    quat_from_euler,
    quat_from_matrix,
    quat_normalize,
)

IMAGE_SENSORS = ("camera", "depth")
RANGING = ("depth", "lidar", "lidar_points", "rangefinder")

SizePx = Annotated[int, Field(ge=1, le=16384)]
Degrees = Annotated[float, Field(ge=-360, le=360)]
Metres = Annotated[float, Field(ge=-1e6, le=1e6)]
Fraction = Annotated[float, Field(ge=0, le=1)]
PAIR = Field(min_length=2, max_length=2)
Row = Annotated[list[float], Field(min_length=3, max_length=3)]

_MATRIX_SLACK = 1e-3


class RotationPart(Part):
    """A rotation in a step's parameters: Euler angles, a quaternion, or a matrix.

    roll_deg, pitch_deg, yaw_deg: applied as yaw, then pitch, then roll (3-2-1). q_wxyz: of any
    length but 0. matrix: 3 x 3 by rows, orthogonal and right-handed.
    """

    roll_deg: Degrees = 0.0
    pitch_deg: Degrees = 0.0
    yaw_deg: Degrees = 0.0
    q_wxyz: Annotated[list[float], Field(min_length=4, max_length=4)] | None = None
    matrix: Annotated[list[Row], Field(min_length=3, max_length=3)] | None = None

    @model_validator(mode="after")
    def _one_form(self) -> "RotationPart":
        angles = {"roll_deg", "pitch_deg", "yaw_deg"} & self.model_fields_set
        forms = [bool(angles), self.q_wxyz is not None, self.matrix is not None]
        if sum(forms) > 1:
            raise ValueError("gives a rotation in more than one way")
        if self.q_wxyz is not None and not any(self.q_wxyz):
            raise KeyFaultError("q_wxyz", "a quaternion of length 0 has no direction")
        if self.matrix is not None:
            m = np.array(self.matrix)
            if np.abs(m @ m.T - np.eye(3)).max() > _MATRIX_SLACK or np.linalg.det(m) < 0:
                raise KeyFaultError("matrix", "is not a rotation (orthogonal, determinant 1)")
        return self

    def quaternion(self) -> Quat:
        """Return the rotation of a step's parameters as a unit quaternion."""
        if self.q_wxyz is not None:
            w, x, y, z = self.q_wxyz
            return quat_normalize((w, x, y, z))
        if self.matrix is not None:
            return quat_normalize(quat_from_matrix(np.array(self.matrix)))
        return quat_from_euler(
            math.radians(self.roll_deg), math.radians(self.pitch_deg), math.radians(self.yaw_deg)
        )


class IntrinsicsPart(Part):
    """A pinhole camera in a step's parameters; cx_px, cy_px: the middle, fy_px: fx_px.

    distortion: OpenCV's coefficients (k1, k2, p1, p2[, k3[, k4, k5, k6]]). width_px, height_px:
    size of the image. fx_px: focal length along the width. fy_px: focal length along the height; by
    default fx_px. cx_px: principal point, from the left; by default the middle. cy_px: principal
    point, from the top; by default the middle.
    """

    width_px: SizePx
    height_px: SizePx
    fx_px: Annotated[float, Field(gt=0, le=1e6)]
    fy_px: Annotated[float, Field(gt=0, le=1e6)] | None = None
    cx_px: float | None = None
    cy_px: float | None = None
    distortion: list[float] = Field(default_factory=list)

    @model_validator(mode="after")
    def _known_lens(self) -> "IntrinsicsPart":
        """Refuse a number of distortion coefficients that no lens model has."""
        if len(self.distortion) not in (0, 4, 5, 8):
            raise KeyFaultError("distortion", "takes 0, 4, 5 or 8 coefficients")
        return self

    def intrinsics(self) -> Intrinsics:
        """Return the camera intrinsics of a step's parameters."""
        return Intrinsics(
            width_px=self.width_px,
            height_px=self.height_px,
            fx_px=self.fx_px,
            fy_px=self.fx_px if self.fy_px is None else self.fy_px,
            cx_px=(self.width_px - 1) / 2.0 if self.cx_px is None else self.cx_px,
            cy_px=(self.height_px - 1) / 2.0 if self.cy_px is None else self.cy_px,
            distortion=tuple(self.distortion),
        )
