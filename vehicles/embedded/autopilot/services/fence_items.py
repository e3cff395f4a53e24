"""The fence that an emulated autopilot enforces: built from its items, and its breach check."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from wil_campaign.vehicles.mavlink.fence_areas import (
    CIRCLES,
    POLYGONS,
    RETURN_POINT,
    FenceCircle,
    FenceItem,
    FencePlace,
    FencePolygon,
    fence_areas,
)
from wil_campaign.worlds.geodesy import LocalFrame

Point = tuple[float, float]
"""North and east, m."""
LocalArea = FencePolygon[Point] | FenceCircle[Point]

FENCE_COMMANDS = frozenset({*POLYGONS, *CIRCLES, RETURN_POINT})


class EmulatedFence(NamedTuple):
    """The emulated fence: outside all exclusions, and inside all inclusions.

    As both firmwares have it: AC_PolyFence_loader::breached, by default without INCLUSION_UNION,
    and Geofence::isInsidePolygonOrCircle of PX4's main in 2026 (its issue 27099).
    """

    areas: tuple[LocalArea, ...] = ()

    def breached(self, north_m: float, east_m: float) -> bool:
        """Return whether a position breaches the emulated fence."""
        return any(_within(area, north_m, east_m) is not area.inside for area in self.areas)


def emulated_fence(items: Sequence[FenceItem], frame: LocalFrame) -> EmulatedFence:
    """Return the fence of uploaded items, in local metres. Raises FenceItemError."""
    areas: list[LocalArea] = []
    for area in fence_areas(items):
        if isinstance(area, FenceCircle):
            areas.append(FenceCircle(_to_local(area.centre, frame), area.radius_m, area.inside))
        else:
            corners = tuple(_to_local(corner, frame) for corner in area.corners)
            areas.append(FencePolygon(corners, area.inside))
    return EmulatedFence(tuple(areas))


def _to_local(place: FencePlace, frame: LocalFrame) -> Point:
    """Return a fence item's place in local metres."""
    north, east, _ = frame.to_ned(place.latitude_deg, place.longitude_deg, frame.altitude_m)
    return (north, east)


def _within(area: LocalArea, north: float, east: float) -> bool:
    if isinstance(area, FenceCircle):
        centre_north, centre_east = area.centre
        return math.hypot(north - centre_north, east - centre_east) < area.radius_m
    return _inside_polygon(area.corners, north, east)


def _inside_polygon(corners: tuple[Point, ...], north: float, east: float) -> bool:
    inside = False
    north_0, east_0 = corners[-1]
    for north_1, east_1 in corners:
        if (east_1 > east) != (east_0 > east):
            crossing = (north_0 - north_1) * (east - east_1) / (east_0 - east_1) + north_1
            if north < crossing:
                inside = not inside
        north_0, east_0 = north_1, east_1
    return inside
