"""The host-side geofence: where a vehicle may be, and whether it can stop inside.

All positions are NED metres in the world's local frame. Independent of the autopilot's own fence.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from operator import itemgetter
from typing import Self

import shapely

from wil_campaign.safety.fence.areas import (
    Area,
    Circle,
    FenceError,
    Point2,
    Polygon,
    Region,
    require_finite,
)
from wil_campaign.safety.fence.stopping import (
    VehicleMotion,
    longest_path_m,
    stopping_path,
    velocities_ahead,
)
from wil_campaign.worlds.frames import Vec3, lerp

__all__ = ["Area", "Circle", "Fence", "FenceBreach", "FenceError", "Polygon"]

_SHORTEST_STEP_M = 0.01
"""The shortest step along a path that is checked close to a boundary."""
_MOST_STEPS = 5_000
"""Of the check of a path. One that needs more counts as a breach: it leads past a boundary for 50 m
less than a centimetre away, or belongs to a velocity that no vehicle has."""
MOST_CORNERS = 1000
"""Of a fence for the guard; neither autopilot takes as many."""
_TOUCH_M = 1e-3
"""A path between two points inside that leads less far outside is not said to leave the fence."""
_ROUNDING_M = 1e-6
_NUDGE_M = 1e-4
_COMPASS = (
    *("north", "north-east", "east", "south-east"),
    *("south", "south-west", "west", "north-west"),
)


@dataclass(frozen=True, slots=True)
class FenceBreach:
    """A breach of the geofence: which boundary is or will be crossed, and where.

    margin_m: signed distance to that boundary now (positive inside). predicted: the vehicle is
    still inside, but cannot stop before `point_ned_m`. boundary: floor, ceiling, "north side" and
    the like, or "exclusion 2" by the order of the fence's exclusions.
    """

    margin_m: float
    predicted: bool
    point_ned_m: Vec3
    boundary: str

    def __str__(self) -> str:
        if self.predicted:
            return f"cannot stop before the fence's {self.boundary}, {self.margin_m:.2f} m away"
        return f"{max(0.0, -self.margin_m):.2f} m outside of the fence's {self.boundary}"


class Fence:
    """A geofence: inside any inclusion, in no exclusion, between floor and ceiling.

    floor_up_m, ceiling_up_m: heights over the world's origin, positive up; None is open.
    Without inclusions the plane is open. Raises FenceError: altitude_swapped, not_finite, or
    empty when nothing bounds it or no place is left.
    """

    def __init__(
        self,
        *,
        inclusions: Iterable[Area] = (),
        exclusions: Iterable[Area] = (),
        floor_up_m: float | None = None,
        ceiling_up_m: float | None = None,
    ) -> None:
        self.inclusions = tuple(inclusions)
        self.exclusions = tuple(exclusions)
        self.floor_up_m = floor_up_m
        self.ceiling_up_m = ceiling_up_m
        require_finite("altitude", floor_up_m or 0.0, ceiling_up_m or 0.0)
        if floor_up_m is not None and ceiling_up_m is not None and floor_up_m >= ceiling_up_m:
            message = f"floor {floor_up_m} m is not below ceiling {ceiling_up_m} m"
            raise FenceError("altitude_swapped", message)
        self._inside = _compile(self.inclusions)
        self._outside = _compile(self.exclusions)
        self._low_m = math.inf if floor_up_m is None else -floor_up_m
        self._high_m = -math.inf if ceiling_up_m is None else -ceiling_up_m
        self._require_some_place()

    @classmethod
    def box(cls, *, north_m: Point2, east_m: Point2, up_m: Point2) -> Self:
        """Return the geofence of a box between (low, high) of each axis."""
        return cls(
            inclusions=(Polygon.rectangle(north_m, east_m),),
            floor_up_m=up_m[0],
            ceiling_up_m=up_m[1],
        )

    def without_floor(self) -> "Fence | None":
        """Return the geofence for takeoff, landing and on the ground; None if it has a floor only.

        The vehicle is near the ground then, and its height estimate may be some decimetres too low.
        """
        if self.floor_up_m is None:
            return self
        if not self.inclusions and not self.exclusions and self.ceiling_up_m is None:
            return None
        return Fence(
            inclusions=self.inclusions,
            exclusions=self.exclusions,
            ceiling_up_m=self.ceiling_up_m,
        )

    def margin_m(self, position_ned_m: Vec3) -> float:
        """Return the signed distance to the geofence's nearest boundary, positive inside, finite.

        The sign is exact. So is the value for one inclusion without exclusions; where areas
        overlap it is never more than the real distance. Raises ValueError for NaN or infinity.
        """
        north_m, east_m, down_m = position_ned_m
        if not math.isfinite(north_m + east_m + down_m):
            raise ValueError(f"position {position_ned_m} is not finite")
        flat_m = self._flat_margin_m(north_m, east_m)
        high_m = min(self._low_m - down_m, down_m - self._high_m)
        if flat_m < 0.0 and high_m < 0.0:
            return -math.hypot(flat_m, high_m)
        return min(flat_m, high_m)

    def outside_between(
        self, start: Vec3, end: Vec3, margins_m: tuple[float, float]
    ) -> tuple[float, float] | None:
        """Return how far along a straight path it is farthest outside: share and signed distance.

        margins_m: `margin_m` of both ends. None where the path leads nowhere outside by more than
        1 mm, and where an end is outside itself. The distance changes by no more than the way: no
        thin exclusion is jumped over.
        """
        length_m = math.dist(start, end)
        ends = (0.0, margins_m[0]), (1.0, margins_m[1])
        worst, waiting = min(ends, key=itemgetter(1)), [ends]
        if worst[1] < 0.0:
            return None
        while waiting:
            (a, margin_a_m), (b, margin_b_m) = waiting.pop()
            least_m = (margin_a_m + margin_b_m - (b - a) * length_m) / 2.0
            if least_m >= min(0.0, worst[1]) - _TOUCH_M:
                continue
            share = (a + b) / 2.0
            middle = share, self.margin_m(lerp(start, end, share))
            worst = min(worst, middle, key=itemgetter(1))
            waiting += [(middle, (b, margin_b_m)), ((a, margin_a_m), middle)]
        return worst if worst[1] < 0.0 else None

    def breached(
        self,
        motion: VehicleMotion,
        *,
        latency_s: float,
        braking_m_s2: float,
        keep_m: float = 0.0,
    ) -> FenceBreach | None:
        """Return the geofence breach of a vehicle not `keep_m` inside, or unable to stop there.

        Its velocity may stay, change by its acceleration, or follow its command: each is checked.
        The whole path to standstill is checked, so that no thin exclusion is jumped over: a step
        as long as the margin cannot leave the fence.
        """
        place = motion.position_ned_m
        margin_m = self.margin_m(place)
        if margin_m < keep_m:
            return FenceBreach(margin_m, False, place, self.boundary(place))
        longest_m = longest_path_m(motion, latency_s=latency_s, braking_m_s2=braking_m_s2)
        if longest_m < margin_m - keep_m - _ROUNDING_M:
            return None  # Nearly always; checking the paths takes ten times as long.
        for then in velocities_ahead(motion, latency_s=latency_s, braking_m_s2=braking_m_s2):
            path = stopping_path(motion, then, latency_s=latency_s, braking_m_s2=braking_m_s2)
            if path.length_m <= margin_m - keep_m:
                continue
            begin = path.braking_from_ned_m
            point = self._first_point_outside(place, begin, keep_m)
            point = point or self._first_point_outside(begin, path.end_ned_m, keep_m)
            if point is not None:
                margin_m = self._boundary_margins_m(place)[self._nearest_kind(point)]
                return FenceBreach(margin_m, True, point, self.boundary(point))
        return None

    def boundary(self, position_ned_m: Vec3) -> str:
        """Return the name of the geofence boundary that is nearest, or exceeded most."""
        kind = self._nearest_kind(position_ned_m)
        return self._side(*position_ned_m[:2]) if kind == "side" else kind

    def _nearest_kind(self, position_ned_m: Vec3) -> str:
        """Return which kind of boundary of the geofence is nearest, or exceeded most."""
        margins_m = self._boundary_margins_m(position_ned_m)
        return min(margins_m, key=lambda name: margins_m[name])

    def _side(self, north_m: float, east_m: float) -> str:
        """Return the name of the geofence's nearest side: an exclusion, or where the side faces."""
        margin_m = self._flat_margin_m(north_m, east_m)
        for index, area in enumerate(self.exclusions, start=1):
            part = area if isinstance(area, Circle) else Region([area])
            if abs(part.distance_m(north_m, east_m) + margin_m) < _ROUNDING_M:
                return "exclusion" if len(self.exclusions) == 1 else f"exclusion {index}"
        north = margin_m - self._flat_margin_m(north_m + _NUDGE_M, east_m)
        east = margin_m - self._flat_margin_m(north_m, east_m + _NUDGE_M)
        return f"{_COMPASS[round(math.degrees(math.atan2(east, north)) / 45.0) % 8]} side"

    def _boundary_margins_m(self, position_ned_m: Vec3) -> dict[str, float]:
        """Return the signed distance to each of the geofence's boundaries, positive inside."""
        north_m, east_m, down_m = position_ned_m
        return {
            "side": self._flat_margin_m(north_m, east_m),
            "floor": self._low_m - down_m,
            "ceiling": down_m - self._high_m,
        }

    def _flat_margin_m(self, north_m: float, east_m: float) -> float:
        """Return the signed horizontal distance to the geofence's areas."""
        inside_m = -math.inf if self._inside else math.inf
        for part in self._inside:
            inside_m = max(inside_m, part.distance_m(north_m, east_m))
        for part in self._outside:
            inside_m = min(inside_m, -part.distance_m(north_m, east_m))
        return inside_m

    def _first_point_outside(self, start: Vec3, end: Vec3, keep_m: float) -> Vec3 | None:
        """Return the first point of a straight path that is not `keep_m` inside; None without."""
        length_m = math.dist(start, end)
        point, gone_m = start, 0.0
        for _ in range(_MOST_STEPS):
            part = min(1.0, gone_m / length_m) if length_m > 0.0 else 1.0
            point = lerp(start, end, part)
            margin_m = self.margin_m(point) - keep_m
            if margin_m < 0.0:
                return point
            if part == 1.0:
                return None
            gone_m += max(margin_m, _SHORTEST_STEP_M)
        return point

    def _require_some_place(self) -> None:
        """Refuse a geofence that bounds nothing, or that is empty."""
        bounded = self.inclusions or self.exclusions
        if not bounded and self.floor_up_m is None and self.ceiling_up_m is None:
            raise FenceError("empty", "the fence bounds nothing: give an area, floor or ceiling")
        if self.inclusions and _nothing_left(self.inclusions, self.exclusions):
            raise FenceError("empty", "the exclusions leave nothing of the inclusions")


def _compile(areas: tuple[Area, ...]) -> tuple[Region | Circle, ...]:
    """Return the geofence's areas prepared for fast distances."""
    polygons = [area for area in areas if isinstance(area, Polygon)]
    circles = [area for area in areas if isinstance(area, Circle)]
    return (*((Region(polygons),) if polygons else ()), *circles)


def require_few_corners(fence: Fence) -> Fence:
    """Return a fence that the guard may be given; a circle counts as three corners.

    Raises FenceError: too_many_points.
    """
    areas = fence.inclusions + fence.exclusions
    count = sum(len(area.corners_m) if isinstance(area, Polygon) else 3 for area in areas)
    if count > MOST_CORNERS:
        message = (
            f"the fence has {count:,} corners (a circle counts as 3), {MOST_CORNERS:,} at most are "
            "accepted; simplify its areas"
        )
        raise FenceError("too_many_points", message)
    return fence


def _nothing_left(inclusions: tuple[Area, ...], exclusions: tuple[Area, ...]) -> bool:
    def shape(area: Area) -> object:
        if isinstance(area, Circle):
            return shapely.Point(area.centre_m).buffer(area.radius_m)
        return shapely.Polygon(area.corners_m)

    left = shapely.union_all([shape(a) for a in inclusions]).difference(
        shapely.union_all([shape(a) for a in exclusions])
    )
    return bool(left.area < 1e-6)
