"""The solid parts of an object, which vehicles can touch, and its openings."""

import math
from dataclasses import dataclass
from typing import Literal

from wil_campaign.worlds.frames import AT_ORIGIN, Pose, Vec3, norm
from wil_campaign.worlds.scene.meshes import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class BoxShape:
    """A box part about its own origin; half extents in metres along forward, right, down."""

    half_m: Vec3

    @property
    def radius_m(self) -> float:
        """Return the radius of the box part's bounding sphere about the origin."""
        return norm(self.half_m)


@dataclass(frozen=True, slots=True)
class SphereShape:
    """A ball part about its own origin."""

    radius_m: float


@dataclass(frozen=True, slots=True, eq=False)
class HullShape:
    """A convex part: vertices (n, 3) metres about its own origin, triangles outwards."""

    vertices_m: FloatArray
    faces: IntArray

    @property
    def radius_m(self) -> float:
        """Return the radius of the convex part's bounding sphere about the origin."""
        return float(((self.vertices_m**2).sum(axis=1).max()) ** 0.5)


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceShape:
    """A part of any triangles, convex or not: only the surface is solid."""

    vertices_m: FloatArray
    faces: IntArray

    @property
    def radius_m(self) -> float:
        """Return the radius of the surface part's bounding sphere about the origin."""
        return float(((self.vertices_m**2).sum(axis=1).max()) ** 0.5)


PartShape = BoxShape | SphereShape | HullShape | SurfaceShape


@dataclass(frozen=True, slots=True, eq=False)
class SolidPart:
    """A part of an object: its shape, and its pose in the object's frame.

    is_floor: what a vehicle stands on; touching it is no collision unless a caller says so.
    """

    name: str
    shape: PartShape
    pose: Pose
    is_floor: bool = False


@dataclass(frozen=True, slots=True)
class OpeningCrossing:
    """Where a path crosses the plane of an object's opening.

    fraction: of the way from the first to the second point. offset_m: distance from the
    opening's centre, to be compared with the opening's limit. direction: +1 along the object's
    forward axis, -1 against it.
    """

    fraction: float
    offset_m: float
    direction: Literal[1, -1]


@dataclass(frozen=True, slots=True)
class ObjectOpening:
    """An opening of an object, to be flown through along the forward axis of `pose`.

    limit_m: half of the inner size. form "square": the offset is the larger one of right and
    down (Chebyshev); "ring": it is radial; "polygon": corners (right, down) round the centre, and
    the offset is by how much nearer the edge is than the limit, which is the centre's distance.
    """

    name: str
    form: Literal["square", "ring", "polygon"]
    limit_m: float
    pose: Pose = AT_ORIGIN
    corners_m: tuple[tuple[float, float], ...] = ()

    def offset_m(self, point_m: Vec3) -> float:
        """Return a point's distance from the opening's centre, beside the axis.

        The limit less the offset is the distance to the edge, negative outside.
        """
        _, right, down = point_m
        if self.form == "polygon":
            return self.limit_m - _distance_within(self.corners_m, (right, down))
        if self.form == "square":
            return max(abs(right), abs(down))
        return math.hypot(right, down)

    def crossing(self, from_m: Vec3, to_m: Vec3) -> OpeningCrossing | None:
        """Return where the line between two points of the object's frame crosses the opening.

        None when both lie on one side. A point in the plane belongs to the side before it, so
        that of consecutive steps exactly one crosses.
        """
        start, end = self.pose.to_local(from_m), self.pose.to_local(to_m)
        if (start[0] > 0.0) == (end[0] > 0.0):
            return None
        fraction = start[0] / (start[0] - end[0])
        middle = (
            0.0,
            start[1] + (end[1] - start[1]) * fraction,
            start[2] + (end[2] - start[2]) * fraction,
        )
        return OpeningCrossing(fraction, self.offset_m(middle), 1 if end[0] > start[0] else -1)


def _distance_within(corners: tuple[tuple[float, float], ...], point: tuple[float, float]) -> float:
    """Return a point's distance to the nearest edge of a polygon; negative outside of it.

    Inside is by the number of edges that a ray crosses (even-odd rule).
    """
    x, y = point
    inside, nearest = False, math.inf
    for (x_0, y_0), (x_1, y_1) in zip(corners, (*corners[1:], corners[0]), strict=True):
        along_x, along_y = x_1 - x_0, y_1 - y_0
        length_2 = along_x**2 + along_y**2
        share = 0.0
        if length_2 > 0.0:
            share = min(max(((x - x_0) * along_x + (y - y_0) * along_y) / length_2, 0.0), 1.0)
        nearest = min(nearest, math.hypot(x - x_0 - share * along_x, y - y_0 - share * along_y))
        if (y_0 > y) != (y_1 > y) and x < x_0 + (y - y_0) / along_y * along_x:
            inside = not inside
    return nearest if inside else -nearest
