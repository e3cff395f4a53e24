"""Distance between a vehicle's body and one part of an object.

Convex parts by our own GJK (`gjk`); triangle surfaces by a tree of them (`surfaces`).
All coordinates are in the object's frame: parts are fixed, the body is placed at a pose.
"""

import math
from dataclasses import dataclass

import numpy as np

from wil_campaign.worlds.clearance.gjk import PRECISION_M, posed_convex_distance
from wil_campaign.worlds.clearance.surfaces import (
    TriangleTree,
    is_swept_beyond,
    surface_distance,
    triangle_tree,
)
from wil_campaign.worlds.frames import Pose, Quat, Vec3, matrix_from_quat, quat_conjugate, rotate
from wil_campaign.worlds.scene.meshes import FloatArray, vec3
from wil_campaign.worlds.scene.parts import (
    BoxShape,
    PartShape,
    SolidPart,
    SphereShape,
    SurfaceShape,
)

Body = BoxShape | SphereShape
"""A vehicle's body for contact: a box (half extents FRD, metres) or a ball."""

_CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)


@dataclass(frozen=True, slots=True)
class PartGap:
    """The distance of a body to a part, 0 at contact, and the unit direction to the body.

    direction: None at contact, and where the part is not convex: then no plane with that
    normal need separate them.
    """

    distance_m: float
    direction: Vec3 | None


CONTACT = PartGap(0.0, None)


class PartSolid:
    """A part prepared for distance measurement, at its place in the object's frame."""

    def __init__(self, part: SolidPart) -> None:
        self.name = part.name
        rotation = matrix_from_quat(part.pose.q_wxyz)
        core, self.rounding_m = _core(part.shape)
        corners = core @ rotation.T + np.array(part.pose.position_ned_m)
        self.corners_m = np.ascontiguousarray(corners)
        self.tree: TriangleTree | None = None
        if isinstance(part.shape, SurfaceShape):
            self.tree = triangle_tree(self.corners_m, part.shape.faces)
        self._low_m = vec3(corners.min(axis=0) - self.rounding_m)
        self._high_m = vec3(corners.max(axis=0) + self.rounding_m)

    def at_least_m(self, center_m: Vec3, reach_m: Vec3) -> float:
        """Return a lower bound of the part's distance from a sphere about a centre."""
        low, high = self._low_m, self._high_m
        x, y, z = center_m
        before, behind = low[0] - x, x - high[0]
        dx = (before if before > behind else behind) - reach_m[0]
        before, behind = low[1] - y, y - high[1]
        dy = (before if before > behind else behind) - reach_m[1]
        before, behind = low[2] - z, z - high[2]
        dz = (before if before > behind else behind) - reach_m[2]
        squares = dx * dx if dx > 0.0 else 0.0
        if dy > 0.0:
            squares += dy * dy
        if dz > 0.0:
            squares += dz * dz
        return math.sqrt(squares)


class BodySolid:
    """The vehicle's body prepared for distance measurement."""

    def __init__(self, body: Body) -> None:
        self.radius_m = body.radius_m
        self._half_m = body.half_m if isinstance(body, BoxShape) else None
        self._corners_m, self._rounding_m = _core(body)

    def gap(self, pose: Pose, part: PartSolid) -> PartGap:
        """Return the distance between the body at a pose in the object's frame and a part."""
        if part.tree is not None:
            corners, at = self._corners_m, pose.position_ned_m
            distance_m = surface_distance(corners, at, pose.q_wxyz, part.tree) - self._rounding_m
            return PartGap(distance_m, None) if distance_m > PRECISION_M else CONTACT
        _, direction, at_least_m = posed_convex_distance(
            self._corners_m, pose.position_ned_m, pose.q_wxyz, part.corners_m
        )
        distance_m = at_least_m - self._rounding_m - part.rounding_m
        return PartGap(distance_m, direction) if distance_m > PRECISION_M else CONTACT

    def stays_beyond(self, tree: TriangleTree, first: Pose, last: Pose, enough_m: float) -> bool:
        """Return whether the body's hull over two poses keeps a distance from triangles."""
        ends = (first.position_ned_m, first.q_wxyz), (last.position_ned_m, last.q_wxyz)
        return is_swept_beyond(self._corners_m, *ends, tree, enough_m + self._rounding_m)

    def reach_m(self, q_wxyz: Quat) -> Vec3:
        """Return the body's extent from its middle along the axes of the object's frame."""
        half = self._half_m
        if half is None:
            return (self.radius_m, self.radius_m, self.radius_m)
        w, x, y, z = q_wxyz
        return (
            abs(1 - 2 * (y * y + z * z)) * half[0]
            + abs(2 * (x * y - w * z)) * half[1]
            + abs(2 * (x * z + w * y)) * half[2],
            abs(2 * (x * y + w * z)) * half[0]
            + abs(1 - 2 * (x * x + z * z)) * half[1]
            + abs(2 * (y * z - w * x)) * half[2],
            abs(2 * (x * z - w * y)) * half[0]
            + abs(2 * (y * z + w * x)) * half[1]
            + abs(1 - 2 * (x * x + y * y)) * half[2],
        )

    def depth_m(self, pose: Pose, direction: Vec3) -> float:
        """Return the least coordinate along a direction of the body at a pose."""
        at = pose.position_ned_m
        center = at[0] * direction[0] + at[1] * direction[1] + at[2] * direction[2]
        half = self._half_m
        if half is None:
            return center - self.radius_m
        own = rotate(quat_conjugate(pose.q_wxyz), direction)
        return center - abs(own[0]) * half[0] - abs(own[1]) * half[1] - abs(own[2]) * half[2]


def _core(shape: PartShape) -> tuple[FloatArray, float]:
    """Return the corners (n, 3) of a shape's core for distances, and its thickness about them."""
    if isinstance(shape, SphereShape):
        return np.zeros((1, 3)), shape.radius_m
    if isinstance(shape, BoxShape):
        return _CUBE * np.array(shape.half_m), 0.0
    return np.ascontiguousarray(shape.vertices_m), 0.0
