"""Distance between a vehicle's body and one part of a thing, through python-fcl (GJK).

Everything is in the thing's frame: parts stay where they are, the body is placed.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import fcl
import numpy as np

from worlds.frames import Pose, Vec3, norm, quat_conjugate, rotate, subtract
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
        self._skin = fcl.CollisionObject(_geometry(_box_surface(body.half_m))) if isinstance(
            body, BoxShape
        ) else self._solid
        self._position, self._q_wxyz = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])

    def place(self, pose: Pose) -> None:
        """Put the body somewhere in the thing's frame."""
        position, q_wxyz = self._position, self._q_wxyz
        position[0], position[1], position[2] = pose.position_ned_m
        q_wxyz[0], q_wxyz[1], q_wxyz[2], q_wxyz[3] = pose.q_wxyz
        self._solid.setTranslation(position)
        self._solid.setQuatRotation(q_wxyz)
        if self._skin is not self._solid:
            self._skin.setTranslation(position)
            self._skin.setQuatRotation(q_wxyz)

    def gap(self, part: "PartSolid") -> Gap:
        """Return the distance between the body where it was placed and a part."""
        result = fcl.DistanceResult()
        solid = self._solid if part.convex else self._skin
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
        self._center_m = part.pose.position_ned_m
        self._back = quat_conjugate(part.pose.q_wxyz)
        self._half_m = part.shape.half_m if isinstance(part.shape, BoxShape) else None
        self._radius_m = part.shape.radius_m
        transform = fcl.Transform(np.array(part.pose.q_wxyz), np.array(part.pose.position_ned_m))
        self.solid = fcl.CollisionObject(_geometry(part.shape), transform)

    def at_least_m(self, point_m: Vec3) -> float:
        """Return a lower bound of the distance from a point; for boxes the distance itself."""
        offset = subtract(point_m, self._center_m)
        half = self._half_m
        if half is None:
            return norm(offset) - self._radius_m
        x, y, z = rotate(self._back, offset)
        return math.sqrt(
            max(abs(x) - half[0], 0.0) ** 2
            + max(abs(y) - half[1], 0.0) ** 2
            + max(abs(z) - half[2], 0.0) ** 2
        )


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
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
    return SurfaceShape(signs * np.array(half_m), np.array(faces, np.int32))
