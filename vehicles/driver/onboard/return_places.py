"""Where an autopilot's failsafe returns to besides home: rally points and a stored mission; pure.

Parameters: PX4's rtl_params.c (RTL_TYPE); ArduCopter's events.cpp, and AP_Rally.cpp.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.autopilots.autopilot import AutopilotName
from wil_campaign.vehicles.driver.onboard.mission_protocol import MissionItem

ReturnsBy = Literal["rally", "landing", "mission"]
"""The closest rally point, a stored mission's landing, or all of the mission's way to it."""

RETURN_TYPE = "RTL_TYPE"
"""PX4's parameter that says which of these places count."""
RALLY_LIMIT = "RALLY_LIMIT_KM"
"""ArduPilot's parameter that says how far a rally point may be; 0 for any distance."""
_RETURNING: Mapping[AutopilotName, Mapping[str, frozenset[int]]] = {
    "px4": {"NAV_DLL_ACT": frozenset({2}), "COM_OBL_RC_ACT": frozenset({3})},
    "ardupilot": {"FS_GCS_ENABLE": frozenset({1, 2, 3, 4, 6})},
}
_PX4_WAYS: Mapping[int, frozenset[ReturnsBy]] = {
    0: frozenset({"rally"}),
    1: frozenset({"rally", "landing"}),
    2: frozenset({"mission"}),
    3: frozenset({"rally", "landing"}),
    4: frozenset({"mission"}),
}
_PX4_NEWER: frozenset[ReturnsBy] = frozenset({"rally", "landing", "mission"})
"""A type that is not known here may do any of it."""
_TO_LANDING_START = 6
"""FS_GCS_ENABLE: to DO_LAND_START or DO_RETURN_PATH_START of the mission, else RTL."""
_STARTS = frozenset({mavlink.MAV_CMD_DO_LAND_START, mavlink.MAV_CMD_DO_RETURN_PATH_START})
_LANDINGS = frozenset({mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_NAV_VTOL_LAND})
_ALSO_PLACES = _STARTS | {mavlink.MAV_CMD_NAV_RALLY_POINT}
_ABOVE_HOME = frozenset(
    {mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT}
)
_LOCAL_FRAMES = frozenset({mavlink.MAV_FRAME_MISSION, mavlink.MAV_FRAME_LOCAL_NED})


def ways_of_return(autopilot: AutopilotName, values: Mapping[str, float]) -> frozenset[ReturnsBy]:
    """Return by which of these places an autopilot's failsafes may return; empty for none."""
    returning = _RETURNING[autopilot]
    if not any(values.get(name) in actions for name, actions in returning.items()):
        return frozenset()
    if autopilot == "px4":
        return _PX4_WAYS.get(int(values.get(RETURN_TYPE, 0)), _PX4_NEWER)
    landing = values["FS_GCS_ENABLE"] == _TO_LANDING_START
    return frozenset({"rally", "landing"}) if landing else frozenset({"rally"})


def rally_limit_m(values: Mapping[str, float]) -> float:
    """Return how far from a vehicle a rally point may be for it to return there."""
    limit_km = values.get(RALLY_LIMIT, 0.0)
    return limit_km * 1000.0 if limit_km > 0.0 else math.inf


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
