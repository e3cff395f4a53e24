"""The items of missions, fences and rally points that PX4 accepts (mavlink_mission.cpp, v1.18)."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.autopilot.flight.mission_items import ItemRules
from wil_campaign.vehicles.embedded.autopilot.services.fence_items import FENCE_COMMANDS

_FLOWN = {16, 17, 19, 20, 21, 22, 31, 93}
"""WAYPOINT, LOITER_UNLIM, LOITER_TIME, RETURN_TO_LAUNCH, LAND, TAKEOFF, LOITER_TO_ALT, DELAY."""
_ACTIONS = {177, 178, 179, 183, 187, 189, 4501}
"""DO_JUMP, CHANGE_SPEED, SET_HOME, SET_SERVO, SET_ACTUATOR, LAND_START; CONDITION_GATE."""
_PAYLOADS = {195, 196, 197, 200, 201, 203, 204, 205, 206, 211, 212, 214, 260, 530, 531, 532}
_CAMERAS = {1000, 1001, 2000, 2001, 2003, 2500, 2501, 42600}

RULES = ItemRules(
    commands={
        mavlink.MAV_MISSION_TYPE_MISSION: frozenset(_FLOWN | _ACTIONS | _PAYLOADS | _CAMERAS),
        mavlink.MAV_MISSION_TYPE_FENCE: FENCE_COMMANDS,
        mavlink.MAV_MISSION_TYPE_RALLY: frozenset({mavlink.MAV_CMD_NAV_RALLY_POINT}),
    },
    frames=frozenset(
        {
            mavlink.MAV_FRAME_GLOBAL,
            mavlink.MAV_FRAME_GLOBAL_INT,
            mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
            mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        }
    ),
    nan_is_unset=True,
)
