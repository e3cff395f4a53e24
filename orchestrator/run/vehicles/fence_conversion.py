"""Converts a campaign's fence into one that an autopilot enforces: areas and a ceiling; pure."""

import math
from collections.abc import Callable, Iterator

import shapely

from wil_campaign.safety.fence.areas import Area, Circle, Point2
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.vehicles.driver.onboard.fence_protocol import AutopilotFence
from wil_campaign.vehicles.mavlink.fence_areas import FenceArea, FenceCircle, FencePolygon, Place
from wil_campaign.worlds.frames import Vec3

_QUARTER = 6
"""Corners of a quarter circle joined with other areas: autopilots store 70 corners in all."""
_CIRCUMSCRIBED = 1.0 / math.cos(math.pi / (4 * _QUARTER))
"""Radius of the corners, by that of the circle: the sides touch it, so that none of it is lost."""

Locate = Callable[[Point2], Place]
"""Returns the place on Earth of a point of the world; north and east in metres."""


def onboard_fence_of(
    fence: Fence, *, margin_m: float, home_ned_m: Vec3, here_m: Point2, locate: Locate
) -> AutopilotFence:
    """Convert a campaign's fence into an onboard fence, wider by a margin.

    home_ned_m: its ceiling is relative to this. here_m: north and east of the vehicle: of several
    separate inclusions only the one around it is converted, for it cannot reach the others. Raises
    ValueError for a ceiling that is not above home.
    """
    areas = [
        *_inclusion(fence.inclusions, here_m, margin_m, locate),
        *(one for area in fence.exclusions for one in _exclusion(area, margin_m, locate)),
    ]
    ceiling_m = None
    if fence.ceiling_up_m is not None:
        ceiling_m = fence.ceiling_up_m + home_ned_m[2] + margin_m
    return AutopilotFence(areas=tuple(areas), ceiling_m=ceiling_m, action="land")


def _inclusion(
    areas: tuple[Area, ...], here_m: Point2, margin_m: float, locate: Locate
) -> Iterator[FenceArea]:
    if len(areas) == 1 and isinstance(areas[0], Circle):
        yield _disc(areas[0], margin_m, inside=True, locate=locate)
        return
    grown = shapely.union_all([_shape(area) for area in areas]).buffer(margin_m, join_style="mitre")
    for part in getattr(grown, "geoms", (grown,)):
        if part.contains(shapely.Point(*here_m)):
            yield _closed_ring(part.exterior, inside=True, locate=locate)
            for hole in part.interiors:
                yield _closed_ring(hole, inside=False, locate=locate)


def _exclusion(area: Area, margin_m: float, locate: Locate) -> Iterator[FenceArea]:
    if isinstance(area, Circle):
        if area.radius_m > margin_m:
            yield _disc(area, -margin_m, inside=False, locate=locate)
        return
    left = _shape(area).buffer(-margin_m, join_style="mitre")
    for part in getattr(left, "geoms", (left,)):
        if part.area > 0.0:
            yield _closed_ring(part.exterior, inside=False, locate=locate)


def _shape(area: Area) -> shapely.Polygon:
    """Return a fence's area as a polygon; around the circle where it is one."""
    if isinstance(area, Circle):
        radius_m = area.radius_m * _CIRCUMSCRIBED
        return shapely.Point(*area.centre_m).buffer(radius_m, quad_segs=_QUARTER)
    return shapely.Polygon(area.corners_m)


def _closed_ring(ring: shapely.LinearRing, *, inside: bool, locate: Locate) -> FencePolygon[Place]:
    corners = [locate((north, east)) for north, east in list(ring.coords)[:-1]]
    return FencePolygon(tuple(corners), inside=inside)


def _disc(circle: Circle, margin_m: float, *, inside: bool, locate: Locate) -> FenceCircle[Place]:
    return FenceCircle(locate(circle.centre_m), circle.radius_m + margin_m, inside=inside)
