"""The areas of a campaign's fence as an autopilot gets them: wider, in local metres; pure."""

import math
from collections.abc import Iterator, Sequence

import shapely

from wil_campaign.safety.fence.areas import Area, Circle, Point2
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.vehicles.mavlink.fence_areas import FenceCircle, FencePolygon

_QUARTER = 6
"""Corners of a quarter circle joined with other areas: autopilots store some 64 corners in all."""
_CIRCUMSCRIBED = 1.0 / math.cos(math.pi / (4 * _QUARTER))
"""Radius of the corners, by that of the circle: the sides touch it, so that none of it is lost."""

LocalArea = FencePolygon[Point2] | FenceCircle[Point2]
"""Of places (north_m, east_m)."""


def onboard_areas(fence: Fence, margin_m: float, here_m: Point2) -> tuple[LocalArea, ...]:
    """Return the areas of a fence wider by a margin, as an autopilot gets them.

    here_m: north and east of the vehicle: of several separate inclusions only the one around it is
    converted, for it cannot reach the others.
    """
    inside = _inclusion(fence.inclusions, here_m, margin_m)
    return (*inside, *(one for area in fence.exclusions for one in _exclusion(area, margin_m)))


def stored_items(areas: Sequence[LocalArea]) -> int:
    """Return how many items an autopilot stores of areas: one for each corner and each circle."""
    return sum(1 if isinstance(area, FenceCircle) else len(area.corners) for area in areas)


def _inclusion(areas: tuple[Area, ...], here_m: Point2, margin_m: float) -> Iterator[LocalArea]:
    if len(areas) == 1 and isinstance(areas[0], Circle):
        yield FenceCircle(areas[0].centre_m, areas[0].radius_m + margin_m)
        return
    grown = shapely.union_all([_shape(area) for area in areas]).buffer(margin_m, join_style="mitre")
    for part in getattr(grown, "geoms", (grown,)):
        if part.contains(shapely.Point(*here_m)):
            yield _closed_ring(part.exterior, inside=True)
            for hole in part.interiors:
                yield _closed_ring(hole, inside=False)


def _exclusion(area: Area, margin_m: float) -> Iterator[LocalArea]:
    if isinstance(area, Circle):
        if area.radius_m > margin_m:
            yield FenceCircle(area.centre_m, area.radius_m - margin_m, inside=False)
        return
    left = _shape(area).buffer(-margin_m, join_style="mitre")
    for part in getattr(left, "geoms", (left,)):
        if part.area > 0.0:
            yield _closed_ring(part.exterior, inside=False)


def _shape(area: Area) -> shapely.Polygon:
    """Return a fence's area as a polygon; around the circle where it is one."""
    if isinstance(area, Circle):
        radius_m = area.radius_m * _CIRCUMSCRIBED
        return shapely.Point(*area.centre_m).buffer(radius_m, quad_segs=_QUARTER)
    return shapely.Polygon(area.corners_m)


def _closed_ring(ring: shapely.LinearRing, *, inside: bool) -> FencePolygon[Point2]:
    corners = tuple((north, east) for north, east in list(ring.coords)[:-1])
    return FencePolygon(corners, inside=inside)
