"""The autopilot's own fence: what the items 5000 to 5004 draw, and whether a place breaks it."""

import math
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from vehicles.embedded.autopilot.flight.mission_items import Item
from worlds.geodesy import LocalFrame

Point = tuple[float, float]
"""North and east, m."""

_POLYGONS = {
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION: True,
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION: False,
}
_CIRCLES = {
    mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION: True,
    mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION: False,
}


class FenceItemError(ValueError):
    """Items that draw no fence."""


class Polygon(NamedTuple):
    """A closed area; `inside`: it must not be left, otherwise not entered."""

    corners: tuple[Point, ...]
    inside: bool


class Circle(NamedTuple):
    """A round area; `inside` as of a polygon."""

    centre: Point
    radius_m: float
    inside: bool


class Fence(NamedTuple):
    """All areas: every exclusion holds; of inclusions one polygon or circle must hold."""

    areas: tuple[Polygon | Circle, ...] = ()

    def breached(self, north_m: float, east_m: float) -> bool:
        """Return whether a place breaks the fence."""
        inclusions = [area for area in self.areas if area.inside]
        if inclusions and not any(_within(area, north_m, east_m) for area in inclusions):
            return True
        return any(_within(area, north_m, east_m) for area in self.areas if not area.inside)


def fence_of(items: tuple[Item, ...], frame: LocalFrame) -> Fence:
    """Return the fence that items draw, in local metres. Raises FenceError."""
    areas: list[Polygon | Circle] = []
    at = 0
    while at < len(items):
        item = items[at]
        if item.command in _POLYGONS:
            count = int(item.params[0])
            corners = items[at : at + count]
            if count < 3 or len(corners) < count:
                raise FenceItemError(f"polygon of {count} corners, {len(corners)} given")
            if any(corner.command != item.command for corner in corners):
                raise FenceItemError("a polygon's corners are of different kinds")
            areas.append(Polygon(tuple(_local(c, frame) for c in corners), _POLYGONS[item.command]))
            at += count
            continue
        if item.command in _CIRCLES:
            radius_m = item.params[0]
            if not 0.0 < radius_m < math.inf:
                raise FenceItemError(f"circle of radius {radius_m}")
            areas.append(Circle(_local(item, frame), radius_m, _CIRCLES[item.command]))
        elif item.command != mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT:
            raise FenceItemError(f"command {item.command} draws no fence")
        at += 1
    return Fence(tuple(areas))


def _local(item: Item, frame: LocalFrame) -> Point:
    north, east, _ = frame.to_ned(item.x * 1e-7, item.y * 1e-7, frame.altitude_m)
    return (north, east)


def _within(area: Polygon | Circle, north: float, east: float) -> bool:
    if isinstance(area, Circle):
        centre_north, centre_east = area.centre
        return math.hypot(north - centre_north, east - centre_east) < area.radius_m
    return _inside_polygon(area.corners, north, east)


def _inside_polygon(corners: tuple[Point, ...], north: float, east: float) -> bool:
    """Return whether a point is inside, by the crossing number."""
    inside = False
    north_0, east_0 = corners[-1]
    for north_1, east_1 in corners:
        if (east_1 > east) != (east_0 > east):
            crossing = (north_0 - north_1) * (east - east_1) / (east_0 - east_1) + north_1
            if north < crossing:
                inside = not inside
        north_0, east_0 = north_1, east_1
    return inside
