"""The pinhole camera: its intrinsics, and its mount on a body."""

import math
from dataclasses import dataclass
from typing import Self

from wil_campaign.worlds.frames import AT_ORIGIN, Pose, Vec3

LEAST_FOV_DEG = 0.001
"""The narrowest horizontal field of view; that of 0 has no focal length."""


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """A pinhole camera with OpenCV's conventions: pixel (0, 0) is the centre of the first pixel.

    The optical frame is x right, y down, z forward; a point (X, Y, Z) there is seen at
    u = fx X/Z + cx, v = fy Y/Z + cy. `distortion` is OpenCV's (k1, k2, p1, p2, k3), or empty.
    """

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion: tuple[float, ...] = ()

    @classmethod
    def from_fov(cls, width_px: int, height_px: int, horizontal_fov_rad: float) -> Self:
        """Return a camera of square pixels that sees `horizontal_fov_rad` edge to edge."""
        focal_px = width_px / 2.0 / math.tan(horizontal_fov_rad / 2.0)
        return cls(
            width_px, height_px, focal_px, focal_px, (width_px - 1) / 2.0, (height_px - 1) / 2.0
        )

    def project(self, point_frd_m: Vec3) -> tuple[float, float] | None:
        """Return the pixel of a point in the camera's FRD frame; None when not in front.

        Ignores distortion; the pixel may lie outside of the image.
        """
        forward, right, down = point_frd_m
        if forward <= 1e-6:
            return None
        return (
            self.fx_px * right / forward + self.cx_px,
            self.fy_px * down / forward + self.cy_px,
        )


@dataclass(frozen=True, slots=True)
class CameraMount:
    """A camera's mount: its pose in the body's FRD frame; its x axis looks out.

    `stabilized` cameras keep roll and pitch level, as a gimbal does: only the body's position
    and heading move them.
    """

    pose: Pose = AT_ORIGIN
    stabilized: bool = False

    def camera_pose(self, body: Pose) -> Pose:
        """Return the camera's pose (FRD axes) in the frame in which the body's pose is given."""
        if not self.stabilized:
            return body.compose(self.pose)
        level = Pose.of(0.0, 0.0, 0.0, yaw_rad=body.yaw_rad)
        position = body.to_parent(self.pose.position_ned_m)
        return Pose(position, level.compose(self.pose).q_wxyz)

    def in_body(self, body: Pose) -> Pose:
        """Return the camera's pose (FRD axes) in the body's frame; a gimbal's turns with it."""
        if not self.stabilized:
            return self.pose
        return body.inverse().compose(self.camera_pose(body))
