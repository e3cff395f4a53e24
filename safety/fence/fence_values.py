"""Converts fences to plain values and back, for messages between processes and recordings."""

from collections.abc import Mapping
from typing import Any

from wil_campaign.safety.fence.areas import Area, Circle, Polygon
from wil_campaign.safety.fence.geofence import Fence


def plain_fence(fence: Fence) -> dict[str, Any]:
    """Return a fence as plain values (msgpack, JSON), for `fence_of_plain`."""
    return {
        "inclusions": [_plain_area(area) for area in fence.inclusions],
        "exclusions": [_plain_area(area) for area in fence.exclusions],
        "floor_up_m": None if fence.floor_up_m is None else float(fence.floor_up_m),
        "ceiling_up_m": None if fence.ceiling_up_m is None else float(fence.ceiling_up_m),
    }


def fence_of_plain(plain: Mapping[str, Any]) -> Fence:
    """Return the fence of plain values.

    Raises FenceError for an invalid fence; KeyError, TypeError or ValueError for other values.
    """
    return Fence(
        inclusions=[_area(area) for area in plain["inclusions"]],
        exclusions=[_area(area) for area in plain["exclusions"]],
        floor_up_m=plain["floor_up_m"],
        ceiling_up_m=plain["ceiling_up_m"],
    )


def _plain_area(area: Area) -> dict[str, Any]:
    if isinstance(area, Circle):
        north_m, east_m = map(float, area.centre_m)
        return {"centre_m": [north_m, east_m], "radius_m": float(area.radius_m)}
    return {"corners_m": [[float(n), float(e)] for n, e in area.corners_m]}


def _area(plain: Mapping[str, Any]) -> Area:
    if "corners_m" in plain:
        return Polygon(tuple((float(n), float(e)) for n, e in plain["corners_m"]))
    north_m, east_m = plain["centre_m"]
    return Circle((float(north_m), float(east_m)), float(plain["radius_m"]))
