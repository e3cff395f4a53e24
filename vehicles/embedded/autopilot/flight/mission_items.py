"""Items of a mission, a fence or a list of rally points, and which of them a firmware accepts."""

import math
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.autopilot.flight.places import is_altitude, is_on_globe

ACCEPTED: int = mavlink.MAV_MISSION_ACCEPTED
_INVALID_PARAMETERS: tuple[int, ...] = (
    mavlink.MAV_MISSION_INVALID_PARAM1,
    mavlink.MAV_MISSION_INVALID_PARAM2,
    mavlink.MAV_MISSION_INVALID_PARAM3,
    mavlink.MAV_MISSION_INVALID_PARAM4,
)

PLACED = frozenset(
    {
        mavlink.MAV_CMD_NAV_WAYPOINT,
        mavlink.MAV_CMD_NAV_LOITER_UNLIM,
        mavlink.MAV_CMD_NAV_LOITER_TURNS,
        mavlink.MAV_CMD_NAV_LOITER_TIME,
        mavlink.MAV_CMD_NAV_LAND,
        mavlink.MAV_CMD_NAV_TAKEOFF,
        mavlink.MAV_CMD_NAV_LOITER_TO_ALT,
        mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT,
        mavlink.MAV_CMD_NAV_RALLY_POINT,
        mavlink.MAV_CMD_DO_SET_ROI_LOCATION,
        mavlink.MAV_CMD_CONDITION_GATE,
    }
)
"""Commands whose x, y and z are latitude, longitude and altitude."""


class EmulatedMissionItem(NamedTuple):
    """A mission item; x and y as transmitted (1e-7 degrees or 1e-4 m), z in metres."""

    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float
    autocontinue: int = 1


class ItemRules(NamedTuple):
    """A firmware's rules of mission items: commands by list, frames of placed items.

    most: how many items of each list it stores.
    nan_is_unset: NaN means "not given" in every parameter (PX4), not only in the fourth.
    unplaced_frame: the frame of items without a place (PX4); None: any. stored_frames: the frames
    that placed items of a mission are sent back in, by those they came in; others come back in 0.
    None: all as they came.
    """

    commands: dict[int, frozenset[int]]
    frames: frozenset[int]
    most: dict[int, int]
    nan_is_unset: bool
    unplaced_frame: int | None = None
    stored_frames: dict[int, int] | None = None


def mission_item_of(message: Any) -> EmulatedMissionItem | int:
    """Return the mission item of a MISSION_ITEM or MISSION_ITEM_INT, or a MAV_MISSION_RESULT.

    The degrees of a MISSION_ITEM are floats and may be NaN: then the item is invalid.
    """
    x, y = message.x, message.y
    if message.get_type() == "MISSION_ITEM":
        if not abs(x) <= 180.0:
            return int(mavlink.MAV_MISSION_INVALID_PARAM5_X)
        if not abs(y) <= 180.0:
            return int(mavlink.MAV_MISSION_INVALID_PARAM6_Y)
        x, y = round(x * 1e7), round(y * 1e7)
    return EmulatedMissionItem(
        message.frame,
        message.command,
        (message.param1, message.param2, message.param3, message.param4),
        x,
        y,
        message.z,
        message.autocontinue,
    )


def mission_item_fault(kind: int, item: EmulatedMissionItem, rules: ItemRules) -> int:
    """Return the MAV_MISSION_RESULT of a firmware for a mission item of a list."""
    if item.command not in rules.commands[kind]:
        return int(mavlink.MAV_MISSION_UNSUPPORTED)
    for index, value in enumerate(item.params):
        unset = math.isnan(value) and (rules.nan_is_unset or index == 3)
        if not (math.isfinite(value) or unset):
            return _INVALID_PARAMETERS[index]
    if rules.unplaced_frame is not None and kind == mavlink.MAV_MISSION_TYPE_MISSION:
        fault = _frame_fault(item, rules)
        if fault != ACCEPTED:
            return fault
    return _place_fault(item, rules) if item.command in PLACED else ACCEPTED


def stored_mission_frame(item: EmulatedMissionItem, rules: ItemRules) -> int:
    """Return the frame that a firmware sends an item of a mission back in."""
    if rules.stored_frames is None:
        return item.frame
    return rules.stored_frames.get(item.frame, 0) if item.command in PLACED else 0


def _frame_fault(item: EmulatedMissionItem, rules: ItemRules) -> int:
    """Return PX4's MAV_MISSION_RESULT of an item's frame (parse_mavlink_mission_item)."""
    if item.frame not in {*rules.frames, rules.unplaced_frame}:
        return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
    placed = item.command in PLACED
    fits = placed is (item.frame != rules.unplaced_frame)
    return ACCEPTED if fits else int(mavlink.MAV_MISSION_UNSUPPORTED)


def _place_fault(item: EmulatedMissionItem, rules: ItemRules) -> int:
    if item.frame not in rules.frames:
        return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
    if not is_on_globe(item.x * 1e-7, 0.0):
        return int(mavlink.MAV_MISSION_INVALID_PARAM5_X)
    if not is_on_globe(0.0, item.y * 1e-7):
        return int(mavlink.MAV_MISSION_INVALID_PARAM6_Y)
    return ACCEPTED if is_altitude(item.z) else int(mavlink.MAV_MISSION_INVALID_PARAM7)
