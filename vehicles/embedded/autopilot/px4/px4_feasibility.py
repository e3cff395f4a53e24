"""Which uploaded missions PX4 does not fly (MissionFeasibility/FeasibilityChecker.cpp)."""

from collections.abc import Sequence

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.autopilot.flight.mission_items import (
    PLACED,
    EmulatedMissionItem,
)
from wil_campaign.vehicles.embedded.autopilot.flight.setpoint_targets import (
    RELATIVE_ALTITUDE_FRAMES,
)

_LEAST_CLIMB_M = 1e-6
_MOVES_NOTHING = {mavlink.MAV_CMD_DO_SET_ROI_LOCATION}


def mission_fault(items: Sequence[EmulatedMissionItem], *, home_amsl_m: float) -> str | None:
    """Return PX4's text for why it does not fly a mission; None when it does."""
    if items and items[0].command == mavlink.MAV_CMD_NAV_LAND:
        return "Mission rejected: starts with land waypoint."
    moved = False
    for item in items:
        if item.command == mavlink.MAV_CMD_NAV_TAKEOFF:
            relative = item.frame in RELATIVE_ALTITUDE_FRAMES
            if item.z - (0.0 if relative else home_amsl_m) < _LEAST_CLIMB_M:
                return "Mission rejected: Takeoff altitude below home altitude!"
            if moved:
                return "Mission rejected: takeoff not first waypoint item"
        returns = item.command == mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH
        moved |= returns or item.command in PLACED - _MOVES_NOTHING
    return None
