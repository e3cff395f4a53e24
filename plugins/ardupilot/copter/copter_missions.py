"""The items of missions, fences and rally points that ArduCopter accepts (AP_Mission.cpp, 4.7)."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.ardupilot.strategy import ArduCopter
from wil_campaign.vehicles.embedded.autopilot.flight.mission_items import ItemRules
from wil_campaign.vehicles.embedded.autopilot.services.fence_items import FENCE_COMMANDS

_FLOWN = {16, 17, 18, 19, 20, 21, 22, 31, 82, 92, 93, 94}
"""WAYPOINT, LOITER_UNLIM, _TURNS and _TIME, RETURN_TO_LAUNCH, LAND, TAKEOFF, LOITER_TO_ALT,
SPLINE_WAYPOINT, GUIDED_ENABLE, DELAY, PAYLOAD_PLACE."""
_CONDITIONS = {112, 114, 115}
_ACTIONS = {177, 178, 179, 181, 182, 183, 184, 188, 189, 207, 208, 216, 218, 222, 223, 600, 601}
_PAYLOADS = {195, 197, 201, 202, 203, 205, 206, 211, 212, 215, 530, 531, 532, 1000, 2000, 2001}
_OTHERS = {2500, 2501, 42600, 42702}

RULES = ItemRules(
    commands={
        mavlink.MAV_MISSION_TYPE_MISSION: frozenset(
            _FLOWN | _CONDITIONS | _ACTIONS | _PAYLOADS | _OTHERS
        ),
        mavlink.MAV_MISSION_TYPE_FENCE: FENCE_COMMANDS,
        mavlink.MAV_MISSION_TYPE_RALLY: frozenset({mavlink.MAV_CMD_NAV_RALLY_POINT}),
    },
    frames=frozenset(
        {
            mavlink.MAV_FRAME_GLOBAL,
            mavlink.MAV_FRAME_MISSION,
            mavlink.MAV_FRAME_GLOBAL_INT,
            mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
            mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
            mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
            mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT,
        }
    ),
    most={
        mavlink.MAV_MISSION_TYPE_MISSION: 700,
        mavlink.MAV_MISSION_TYPE_FENCE: ArduCopter.most_fence_items,
        mavlink.MAV_MISSION_TYPE_RALLY: 46,
    },
    nan_is_unset=False,
    stored_frames={
        mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
        mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
        mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT: mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
        mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT: mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
    },
)
