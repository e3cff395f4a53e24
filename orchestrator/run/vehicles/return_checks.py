"""Holds the places that an autopilot's failsafe may return to against the campaign's fence."""

import math
from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.vehicles.autopilots.failsafes import ReturnsBy
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.driver.onboard.mission_protocol import (
    ItemList,
    MissionError,
    MissionItem,
    UnsupportedListError,
)
from wil_campaign.vehicles.errors import AnchorError
from wil_campaign.worlds.frames import Vec3, add
from wil_campaign.worlds.geodesy import LocalFrame

_DEGREES = 1e-7
_NAMES: Mapping[ItemList, str] = {
    ItemList.RALLY: "rally points",
    ItemList.MISSION: "stored mission",
}
_LISTS: Mapping[ItemList, frozenset[ReturnsBy]] = {
    ItemList.RALLY: frozenset({"rally"}),
    ItemList.MISSION: frozenset({"landing", "mission"}),
}


Known = Callable[[Iterable[str]], Awaitable[Mapping[str, float]]]
"""Returns name and value of the first of these parameters that the firmware knows."""


class _Outside(NamedTuple):
    """The place farthest outside of the fence: its number in the list, and how far; metres."""

    number: int
    by_m: float


async def return_faults(
    context: VehicleContext, fence: Fence, values: Mapping[str, float], known: Known
) -> tuple[str, ...]:
    """Return in words which places that a failsafe may return to are not inside the fence.

    values: of the autopilot's failsafe parameters.
    """
    failsafes = autopilot_named(context.driver.identity.autopilot).failsafes
    if not failsafes.ways_of_return(values):
        return ()
    if failsafes.return_type is not None:
        values = {**values, **await known((failsafes.return_type,))}
    ways = failsafes.ways_of_return(values)
    faults: list[str] = []
    for which, flown_to in _LISTS.items():
        if ways & flown_to:
            faults += await _faults(context, fence, which, ways, known)
    return tuple(faults)


async def _faults(
    context: VehicleContext,
    fence: Fence,
    which: ItemList,
    ways: frozenset[ReturnsBy],
    known: Known,
) -> Iterable[str]:
    """Return what is wrong with a list of places that the failsafe returns to."""
    name = _NAMES[which]
    try:
        items = await context.driver.onboard.missions.download(which)
    except UnsupportedListError:
        return ()
    except MissionError as error:
        return (f"its {name} may be where it would return to, and are not known: {error}",)
    places = list(places_of_items(items))
    if which is ItemList.MISSION and "mission" not in ways:
        first = landing_item_number(items)
        places = [] if first is None else [one for one in places if one[0] >= first]
    if not places:
        return ()
    within_m = math.inf
    failsafes = autopilot_named(context.driver.identity.autopilot).failsafes
    if which is ItemList.RALLY and failsafes.rally_limit is not None:
        within_m = failsafes.rally_limit_m(await known((failsafes.rally_limit,)))
    try:
        outside = _farthest(context, fence, places, within_m)
    except AnchorError as error:
        return (f"its {name} cannot be held against the fence: {error}",)
    if outside is None:
        return ()
    place = f"item {outside.number} of its {name}, {outside.by_m:.0f} m outside of the fence"
    return (f"it would return to {place}; clear its {name}",)


def _farthest(
    context: VehicleContext,
    fence: Fence,
    places: Iterable[tuple[int, MissionItem]],
    within_m: float,
) -> _Outside | None:
    """Return the place that is farthest outside of a fence; None if all are inside.

    Places farther than `within_m` from the start are not flown to. Raises AnchorError.
    """
    start_ned_m = context.start.position_ned_m
    outside = [
        _Outside(number, -margin_m)
        for number, at_ned_m in _positions(context, places)
        if math.dist(at_ned_m[:2], start_ned_m[:2]) <= within_m
        and (margin_m := fence.margin_m(at_ned_m)) < 0.0
    ]
    return max(outside, key=lambda one: one.by_m, default=None)


def _positions(
    context: VehicleContext, places: Iterable[tuple[int, MissionItem]]
) -> Iterator[tuple[int, Vec3]]:
    """Yield the places' numbers and positions in the world; without a height, on the ground.

    Raises AnchorError.
    """
    driver, start_ned_m = context.driver, context.start.position_ned_m
    here = driver.place_of(start_ned_m)
    frame = LocalFrame(here.latitude_deg, here.longitude_deg, 0.0)
    anchor = driver.anchor
    for number, item in places:
        north_m, east_m, _ = frame.to_ned(item.x * _DEGREES, item.y * _DEGREES, 0.0)
        up_m = max(0.0, height_above_home_m(item) or 0.0)
        offset: Vec3 = (north_m, east_m, -up_m)
        # From the autopilot's north to the world's. Without an anchor, `place_of` raises.
        yield number, add(start_ned_m, offset if anchor is None else anchor.velocity(offset))


_STARTS = frozenset({mavlink.MAV_CMD_DO_LAND_START, mavlink.MAV_CMD_DO_RETURN_PATH_START})
_LANDINGS = frozenset({mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_NAV_VTOL_LAND})
_ALSO_PLACES = _STARTS | {mavlink.MAV_CMD_NAV_RALLY_POINT}
_ABOVE_HOME = frozenset(
    {mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT}
)
_LOCAL_FRAMES = frozenset({mavlink.MAV_FRAME_MISSION, mavlink.MAV_FRAME_LOCAL_NED})


def places_of_items(items: Iterable[MissionItem]) -> Iterator[tuple[int, MissionItem]]:
    """Yield those items of a list that are places on Earth, each with its number from 1."""
    for number, item in enumerate(items, start=1):
        flown_to = item.command < mavlink.MAV_CMD_NAV_LAST or item.command in _ALSO_PLACES
        if flown_to and item.frame not in _LOCAL_FRAMES and (item.x or item.y):
            yield number, item


def landing_item_number(items: Sequence[MissionItem]) -> int | None:
    """Return the number from 1 of the item at which a mission's landing begins; None for none."""
    for kinds in (_STARTS, _LANDINGS):
        for number, item in enumerate(items, start=1):
            if item.command in kinds:
                return number
    return None


def height_above_home_m(item: MissionItem) -> float | None:
    """Return an item's height above home; None where it is above the sea or the terrain."""
    return item.z if item.frame in _ABOVE_HOME and math.isfinite(item.z) else None
