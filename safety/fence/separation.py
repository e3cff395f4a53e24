"""The horizontal distance between the areas of two fences; pure.

Height does not separate vehicles, because they come down to land.
"""

from dataclasses import replace

import shapely
import shapely.affinity

from wil_campaign.safety.fence.areas import Circle
from wil_campaign.safety.fence.geofence import Area, Fence
from wil_campaign.vehicles.poses.anchor import Anchor
from wil_campaign.worlds.frames import Pose

_QUARTER = 16
"""Segments of a quarter circle; the polygon is drawn around the circle."""


def fence_separation_m(one: Fence, other: Fence) -> float:
    """Return the distance between the areas of two fences; 0 where they meet or have no edge."""
    if not one.inclusions or not other.inclusions:
        return 0.0
    return float(shapely.distance(_inside(one), _inside(other)))


def moved_fence(fence: Fence, *, start: Pose, to: Pose) -> Fence:
    """Return a fence moved with a vehicle that is at `to` but takes that for `start`."""
    anchor = Anchor.of_poses(local=start, world=to)

    def area(one: Area) -> Area:
        if isinstance(one, Circle):
            return replace(one, centre_m=anchor.position((*one.centre_m, 0.0))[:2])
        corners = (anchor.position((*corner, 0.0))[:2] for corner in one.corners_m)
        return replace(one, corners_m=tuple(corners))

    up_m = start.position_ned_m[2] - to.position_ned_m[2]
    low_m, high_m = fence.floor_up_m, fence.ceiling_up_m
    return Fence(
        inclusions=map(area, fence.inclusions),
        exclusions=map(area, fence.exclusions),
        floor_up_m=None if low_m is None else low_m + up_m,
        ceiling_up_m=None if high_m is None else high_m + up_m,
    )


def _inside(fence: Fence) -> shapely.Geometry:
    """Return the area where a fence's vehicle may be, exclusions ignored; never too small."""
    return shapely.union_all([_shape(inclusion) for inclusion in fence.inclusions])


def _shape(area: Area) -> shapely.Geometry:
    """Return a shape that contains an area."""
    if isinstance(area, Circle):
        inner = shapely.Point(*area.centre_m).buffer(area.radius_m, quad_segs=_QUARTER)
        grown = area.radius_m**2 / shapely.distance(shapely.Point(*area.centre_m), inner.exterior)
        return shapely.Point(*area.centre_m).buffer(grown, quad_segs=_QUARTER)
    return shapely.Polygon(area.corners_m)
