"""How ArduCopter flies its modes: behaviours from its parameters and the state."""

import math

from vehicles.embedded.autopilot.flying.guidance import (
    GoTo,
    Land,
    LandProfile,
    ReturnHome,
    Speeds,
    TakeOff,
)
from vehicles.embedded.autopilot.flying.state import State
from vehicles.embedded.autopilot.services.parameters import Parameters
from worlds.frames import Vec3

_FACES_WAYPOINT = {1, 2}
"""WP_YAW_BEHAVIOR: the nose turns to the next waypoint."""
_FACE_BEYOND_M = 2.0
_TAKEOFF_RADIUS_M = 0.22
_CLIMB_AT_LEAST_M = 2.5
"""RTL_ABS_MIN_CLIMB."""
_LEAST_SLOPE = 0.5
"""RTL_MIN_CONE_SLOPE: shallower cones are none."""


def speeds(p: Parameters) -> Speeds:
    """Return the limits of the automatic modes."""
    return Speeds(p["WP_SPD"], p["WP_SPD_UP"], p["WP_SPD_DN"])


def take_off(p: Parameters, down_m: float) -> TakeOff:
    """Return the climb to a local height."""
    limits = speeds(p)
    return TakeOff(
        down_m=down_m, climb_m_s=limits.up, ramp_s=0.0, radius_m=_TAKEOFF_RADIUS_M, speeds=limits
    )


def go_to(p: Parameters, state: State, position_ned_m: Vec3, radius_m: float) -> GoTo:
    """Return the flight to a place, facing it when it is some way off."""
    here, yaw_rad = state.now.position_ned_m, state.now.euler_rad[2]
    north, east = position_ned_m[0] - here[0], position_ned_m[1] - here[1]
    if int(p["WP_YAW_BEHAVIOR"]) in _FACES_WAYPOINT and math.hypot(north, east) > _FACE_BEYOND_M:
        yaw_rad = math.atan2(east, north)
    return GoTo(position_ned_m=position_ned_m, yaw_rad=yaw_rad, speeds=speeds(p), radius_m=radius_m)


def land(p: Parameters, state: State) -> Land:
    """Return the landing here: fast above LAND_ALT_LOW_M, slow below."""
    fast = p["LAND_SPD_HIGH_MS"] or p["WP_SPD_DN"]
    low_m = p["LAND_ALT_LOW_M"]
    return Land(
        profile=LandProfile(((low_m + 0.01, fast), (low_m, p["LAND_SPD_MS"]))),
        speeds=speeds(p),
        ground_down_m=state.home_down_m,
    )


def return_height_m(p: Parameters, state: State) -> float:
    """Return how high above home to fly back (ModeRTL::compute_return_target)."""
    here, home = state.now.position_ned_m, state.home_ned_m or (0.0, 0.0, 0.0)
    height_m = home[2] - here[2]
    target_m = max(height_m + max(0.0, p["RTL_CLIMB_MIN_M"]), p["RTL_ALT_M"])
    slope = p["RTL_CONE_SLOPE"]
    if slope >= _LEAST_SLOPE:
        distance_m = math.hypot(here[0] - home[0], here[1] - home[1])
        target_m = min(target_m, max(distance_m * slope, height_m + _CLIMB_AT_LEAST_M))
    return max(height_m, target_m)


def return_home(p: Parameters, state: State) -> ReturnHome:
    """Return the flight home, the wait above it, and the landing."""
    home = state.home_ned_m or (0.0, 0.0, 0.0)
    limits = speeds(p)
    return ReturnHome(
        home_ned_m=home,
        return_down_m=home[2] - return_height_m(p, state),
        speeds=limits._replace(across=p["RTL_SPEED_MS"] or limits.across),
        wait_s=p["RTL_LOIT_TIME"] / 1e3,
        land=land(p, state),
    )
