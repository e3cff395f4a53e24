"""Where an autopilot's failsafe returns to besides home: rally points, a stored mission; pure."""

import math
from collections.abc import Iterable, Iterator, Sequence

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.driver.onboard.mission_protocol import MissionItem

_STARTS = frozenset({mavlink.MAV_CMD_DO_LAND_START, mavlink.MAV_CMD_DO_RETURN_PATH_START})
_LANDINGS = frozenset({mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_NAV_VTOL_LAND})
_ALSO_PLACES = _STARTS | {mavlink.MAV_CMD_NAV_RALLY_POINT}
_ABOVE_HOME = frozenset(
    {mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT}
)
_LOCAL_FRAMES = frozenset({mavlink.MAV_FRAME_MISSION, mavlink.MAV_FRAME_LOCAL_NED})


def places_of(items: Iterable[MissionItem]) -> Iterator[tuple[int, MissionItem]]:
    """Yield those items of a list that are places on Earth, each with its number from 1."""
    for number, item in enumerate(items, start=1):
        flown_to = item.command < mavlink.MAV_CMD_NAV_LAST or item.command in _ALSO_PLACES
        if flown_to and item.frame not in _LOCAL_FRAMES and (item.x or item.y):
            yield number, item


def landing_of(items: Sequence[MissionItem]) -> int | None:
    """Return the number from 1 of the item at which a mission's landing begins; None for none."""
    for kinds in (_STARTS, _LANDINGS):
        for number, item in enumerate(items, start=1):
            if item.command in kinds:
                return number
    return None


def height_above_home_m(item: MissionItem) -> float | None:
    """Return an item's height above home; None where it is above the sea or the terrain."""
    return item.z if item.frame in _ABOVE_HOME and math.isfinite(item.z) else None
