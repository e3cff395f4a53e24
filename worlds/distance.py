"""Distance between a vehicle's body and one part of a thing, through python-fcl (GJK).

Everything is in the thing's frame: parts stay where they are, the body is placed.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import fcl
import numpy as np

from worlds.frames import Pose, Quat, Vec3, matrix_from_quat, quat_conjugate, rotate
from worlds.meshes import FloatArray
from worlds.parts import (
    BoxShape,
    CylinderShape,
    HullShape,
    Part,
    PartShape,
    SphereShape,
    SurfaceShape,
)

Body = BoxShape | SphereShape
"""A vehicle for the purpose of touching: a box (half extents FRD, metres) or a ball."""


@dataclass(frozen=True, slots=True)
class Gap:
    """A distance, 0 at contact, and the unit direction from the part to the body.

    direction: None at contact, and where the part is not convex: then no plane with that
    normal need separate them.
    """

    distance_m: float
    direction: Vec3 | None


CONTACT = Gap(0.0, None)


class BodySolid:
    """The body as python-fcl holds it. Not for use by two threads at once."""

    def __init__(self, body: Body) -> None:
        self.radius_m = body.radius_m
        self._half_m = body.half_m if isinstance(body, BoxShape) else None
        self._solid = fcl.CollisionObject(_geometry(body))
        # A box against triangles is slow and one-sided in FCL; its own triangles are neither.
        self._skin = (
            fcl.CollisionObject(_geometry(_box_surface(body.half_m)))
            if isinstance(body, BoxShape)
            else self._solid
        )
        self._position, self._q_wxyz = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])

    def gap(self, pose: Pose, part: "PartSolid") -> Gap:
        """Return the distance between the body at a pose in the thing's frame and a part."""
        solid = self._solid if part.convex else self._skin
        position, q_wxyz = self._position, self._q_wxyz
        position[0], position[1], position[2] = pose.position_ned_m
        q_wxyz[0], q_wxyz[1], q_wxyz[2], q_wxyz[3] = pose.q_wxyz
        solid.setTranslation(position)
        solid.setQuatRotation(q_wxyz)
        result = fcl.DistanceResult()
        distance_m = fcl.distance(solid, part.solid, _REQUEST, result)
        if distance_m <= 0.0:
            return CONTACT
        if not part.convex or distance_m < _TOO_CLOSE_M:
            return Gap(distance_m, None)
        mine, other = result.nearest_points
        direction = (
            float(mine[0] - other[0]) / distance_m,
            float(mine[1] - other[1]) / distance_m,
            float(mine[2] - other[2]) / distance_m,
        )
        return Gap(distance_m, direction)

    def reach_m(self, q_wxyz: Quat) -> Vec3:
        """Return how far the body reaches from its middle along the axes of the thing's frame."""
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
        if self._half_m is None:
            return center - self.radius_m
        own = rotate(quat_conjugate(pose.q_wxyz), direction)
        half = self._half_m
        return center - abs(own[0]) * half[0] - abs(own[1]) * half[1] - abs(own[2]) * half[2]


class PartSolid:
    """A part as python-fcl holds it, at its place in the thing's frame."""

    def __init__(self, part: Part) -> None:
        self.name = part.name
        self.convex = not isinstance(part.shape, SurfaceShape)
        self._low_m, self._high_m = extent_m(part)
        transform = fcl.Transform(np.array(part.pose.q_wxyz), np.array(part.pose.position_ned_m))
        self.solid = fcl.CollisionObject(_geometry(part.shape), transform)

    def at_least_m(self, center_m: Vec3, reach_m: Vec3) -> float:
        """Return a lower bound of the distance from anything that reaches so far from a centre."""
        low, high = self._low_m, self._high_m
        x, y, z = center_m
        rx, ry, rz = reach_m
        dx = max(low[0] - x, x - high[0]) - rx
        dy = max(low[1] - y, y - high[1]) - ry
        dz = max(low[2] - z, z - high[2]) - rz
        squares = 0.0
        if dx > 0.0:
            squares = dx * dx
        if dy > 0.0:
            squares += dy * dy
        if dz > 0.0:
            squares += dz * dz
        return math.sqrt(squares)


def extent_m(part: Part) -> tuple[Vec3, Vec3]:
    """Return the least and greatest coordinates of a part in the thing's frame."""
    rotation = matrix_from_quat(part.pose.q_wxyz)
    center = np.array(part.pose.position_ned_m)
    shape = part.shape
    if isinstance(shape, HullShape | SurfaceShape):
        points = shape.vertices_m @ rotation.T
        return _vec3(center + points.min(axis=0)), _vec3(center + points.max(axis=0))
    if isinstance(shape, SphereShape):
        reach = np.full(3, shape.radius_m)
    elif isinstance(shape, BoxShape):
        reach = np.abs(rotation) @ np.array(shape.half_m)
    else:
        radius = shape.cylinder_radius_m
        reach = np.abs(rotation) @ np.array([radius, radius, shape.half_height_m])
    return _vec3(center - reach), _vec3(center + reach)


def _vec3(array: FloatArray) -> Vec3:
    return (float(array[0]), float(array[1]), float(array[2]))


_TOO_CLOSE_M = 1e-6
"""Below this the nearest points do not tell a direction."""
_REQUEST = fcl.DistanceRequest(enable_nearest_points=True)


def _geometry(shape: PartShape) -> fcl.CollisionGeometry:
    makers: dict[type, Callable[..., fcl.CollisionGeometry]] = {
        BoxShape: _box,
        SphereShape: lambda sphere: fcl.Sphere(sphere.radius_m),
        CylinderShape: _cylinder,
        HullShape: _hull,
        SurfaceShape: _surface,
    }
    return makers[type(shape)](shape)


def _box(box: BoxShape) -> fcl.CollisionGeometry:
    return fcl.Box(*(2.0 * half for half in box.half_m))


def _cylinder(cylinder: CylinderShape) -> fcl.CollisionGeometry:
    return fcl.Cylinder(cylinder.cylinder_radius_m, 2.0 * cylinder.half_height_m)


def _hull(hull: HullShape) -> fcl.CollisionGeometry:
    counted = np.insert(hull.faces, 0, 3, axis=1).astype(np.int32)
    return fcl.Convex(np.ascontiguousarray(hull.vertices_m), len(hull.faces), counted.ravel())


def _surface(surface: SurfaceShape) -> fcl.CollisionGeometry:
    model = fcl.BVHModel()
    model.beginModel(len(surface.vertices_m), len(surface.faces))
    model.addSubModel(surface.vertices_m, surface.faces)
    model.endModel()
    return model


def _box_surface(half_m: Vec3) -> SurfaceShape:
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
    faces = [
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 5, 7],
        [1, 7, 3],
    ]
    return SurfaceShape(signs * np.array(half_m), np.array(faces, np.int32))
