"""Flat areas of the horizontal plane and the signed distance to their edge.

Coordinates are (north_m, east_m) in the world's local frame. Signed distances are positive inside.
"""

import itertools
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import shapely
from shapely.validation import explain_validity

Point2 = tuple[float, float]
Reason = Literal[
    "not_finite",
    "too_few_points",
    "too_many_points",
    "self_intersecting",
    "no_area",
    "radius",
    "altitude_swapped",
    "empty",
    "excludes_point",
    "latitude",
    "far",
]

_SHAPELY_ABOVE_EDGES = 24
"""Up to this count a loop in Python is faster than a call of shapely (bench: 0.2 us an edge)."""


class FenceError(ValueError):
    """An invalid fence area; `reason` for programs, the message for people."""

    def __init__(self, reason: Reason, message: str) -> None:
        super().__init__(message)
        self.reason: Reason = reason


def require_finite(what: str, *values: float) -> None:
    """Raise FenceError when any coordinate of an area is NaN or infinite."""
    if not all(map(math.isfinite, values)):
        raise FenceError("not_finite", f"{what}: {values} is not finite")


_QUARTER = 32
"""Corners of a quarter circle: the polygon in it is 0.03 % of the radius smaller."""
_CIRCUMSCRIBED = 1.0 / math.cos(math.pi / (4 * _QUARTER))
_NO_AREA_M2 = 1e-6
_PLACE = re.compile(r"\[(\S+) (\S+)\]")
"""GEOS reports a place as in "Self-intersection[1.5 0]"."""


@dataclass(frozen=True, slots=True)
class Polygon:
    """A polygon area by corners (north_m, east_m), simple, in either orientation, not closed.

    Raises FenceError: too few corners, not finite, self-intersecting, no area.
    """

    corners_m: tuple[Point2, ...]

    def __post_init__(self) -> None:
        for corner in self.corners_m:
            require_finite("polygon corner", *corner)
        if len(set(self.corners_m)) < 3:
            count = len(set(self.corners_m))
            raise FenceError("too_few_points", f"a polygon needs 3 different corners, has {count}")
        shape = shapely.Polygon(self.corners_m)
        # A polygon that crosses itself may have no area by sign; its hull has.
        if shape.convex_hull.area < 1e-6:
            raise FenceError("no_area", "the polygon has no area")
        if not shape.is_valid:
            where = _find_crossing(shape)
            raise FenceError("self_intersecting", f"the polygon crosses itself{where}")

    @classmethod
    def rectangle(cls, north_m: Point2, east_m: Point2) -> "Polygon":
        """Return the polygon between two norths and two easts, each (low, high)."""
        for axis, (low, high) in (("north_m", north_m), ("east_m", east_m)):
            require_finite(axis, low, high)
            if low >= high:
                raise FenceError("no_area", f"{axis}: {low} is not below {high}")
        (n_0, n_1), (e_0, e_1) = north_m, east_m
        return cls(((n_0, e_0), (n_1, e_0), (n_1, e_1), (n_0, e_1)))


@dataclass(frozen=True, slots=True)
class Circle:
    """A circle area by centre (north_m, east_m) and radius. Raises FenceError if invalid."""

    centre_m: Point2
    radius_m: float

    def __post_init__(self) -> None:
        require_finite("circle", *self.centre_m, self.radius_m)
        if self.radius_m <= 0:
            raise FenceError("radius", f"a circle needs a positive radius, has {self.radius_m}")

    def distance_m(self, north_m: float, east_m: float) -> float:
        """Return the signed distance of a point to the circle's edge."""
        return self.radius_m - math.hypot(north_m - self.centre_m[0], east_m - self.centre_m[1])


Area = Polygon | Circle


def common_areas(areas: Sequence[Area]) -> tuple[Area, ...]:
    """Return what areas have in common; of circles an inscribed polygon. Raises FenceError.

    An area within all others is returned as it is.
    """
    shapes = [_outline(area, 1.0) for area in areas]
    for index, area in enumerate(areas):
        around = _outline(area, _CIRCUMSCRIBED)
        others = (*shapes[:index], *shapes[index + 1 :])
        if all(shapely.covers(one, around) for one in others):
            return (area,)
    common = shapely.intersection_all(shapes)
    rings = [part.exterior for part in _parts(common) if part.area > _NO_AREA_M2]
    if not rings:
        message = f"no place is inside all {len(areas)} inclusions, as both autopilots require"
        raise FenceError("empty", message)
    return tuple(Polygon(tuple((n, e) for n, e in list(ring.coords)[:-1])) for ring in rings)


def _outline(area: Area, factor: float) -> Any:
    """Return an area as a polygon of shapely; a circle with its corners at factor radii."""
    if isinstance(area, Circle):
        radius_m = area.radius_m * factor
        return shapely.Point(*area.centre_m).buffer(radius_m, quad_segs=_QUARTER)
    return shapely.Polygon(area.corners_m)


class Region:
    """The union of polygon areas, with a fast exact signed distance to its edge."""

    def __init__(self, polygons: Sequence[Polygon]) -> None:
        shape = shapely.union_all([shapely.Polygon(p.corners_m) for p in polygons])
        rings = [ring for part in _parts(shape) for ring in (part.exterior, *part.interiors)]
        self._edges = tuple(edge for ring in rings for edge in _edges(ring.coords))
        self._shape = shape
        self._boundary = shape.boundary
        self._by_shapely = len(self._edges) > _SHAPELY_ABOVE_EDGES
        shapely.prepare(self._shape)
        shapely.prepare(self._boundary)

    def distance_m(self, north_m: float, east_m: float) -> float:
        """Return the signed distance of a point to the edge of the areas."""
        if self._by_shapely:
            point = shapely.Point(north_m, east_m)
            distance = float(shapely.distance(self._boundary, point))
            return distance if shapely.contains_xy(self._shape, north_m, east_m) else -distance
        return self._distance_by_loop(north_m, east_m)

    def _distance_by_loop(self, north_m: float, east_m: float) -> float:
        """Return the signed distance to the areas' edge by a plain loop over edges."""
        nearest, inside = math.inf, False
        for n_0, e_0, e_1, dn, de, per_length_2 in self._edges:
            pn, pe = north_m - n_0, east_m - e_0
            along = (pn * dn + pe * de) * per_length_2
            along = 0.0 if along < 0.0 else (along if along < 1.0 else 1.0)
            rn, re = pn - along * dn, pe - along * de
            square = rn * rn + re * re
            nearest = square if square < nearest else nearest
            # Compares the easts themselves: rounded differences could put a corner on both sides.
            if (e_0 > east_m) != (e_1 > east_m) and (pn * de < dn * pe) == (de > 0.0):
                inside = not inside
        return math.sqrt(nearest) if inside else -math.sqrt(nearest)


def _parts(shape: Any) -> Iterable[Any]:
    """Return the single polygons of a shapely area."""
    parts = getattr(shape, "geoms", (shape,))
    return [part for part in parts if part.geom_type == "Polygon"]


def _edges(coords: Iterable[Point2]) -> Iterable[tuple[float, float, float, float, float, float]]:
    """Yield the edges of an area as start, end east, direction and 1 / length squared."""
    corners = [(float(n), float(e)) for n, e in coords]
    for (n_0, e_0), (n_1, e_1) in itertools.pairwise(corners):
        dn, de = n_1 - n_0, e_1 - e_0
        if square := dn * dn + de * de:
            yield n_0, e_0, e_1, dn, de, 1.0 / square


def _find_crossing(shape: shapely.Polygon) -> str:
    """Return where a polygon area crosses itself as text; "" when not known."""
    found = _PLACE.search(explain_validity(shape))
    return f" at north {float(found[1]):g} m, east {float(found[2]):g} m" if found else ""
