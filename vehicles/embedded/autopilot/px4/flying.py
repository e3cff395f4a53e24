"""How PX4 flies its modes: behaviours from its parameters and the state."""

import math

from vehicles.embedded.autopilot.flying.guidance import (
    Land,
    LandProfile,
    ReturnHome,
    Speeds,
    TakeOff,
)
from vehicles.embedded.autopilot.flying.state import State
from vehicles.embedded.autopilot.services.parameters import Parameters


def speeds(p: Parameters) -> Speeds:
    """Return the limits of the automatic modes."""
    return Speeds(p["MPC_XY_CRUISE"], p["MPC_Z_V_AUTO_UP"], p["MPC_Z_V_AUTO_DN"])


def offboard_speeds(p: Parameters) -> Speeds:
    """Return the limits of OFFBOARD."""
    return Speeds(p["MPC_XY_VEL_MAX"], p["MPC_Z_VEL_MAX_UP"], p["MPC_Z_VEL_MAX_DN"])


def take_off(p: Parameters, state: State, down_m: float) -> TakeOff:
    """Return the climb to a height, no lower than the present one."""
    return TakeOff(
        down_m=min(down_m, state.now.position_ned_m[2]),
        climb_m_s=p["MPC_TKO_SPEED"],
        ramp_s=p["MPC_TKO_RAMP_T"],
        radius_m=p["NAV_MC_ALT_RAD"],
        speeds=speeds(p),
    )


def land(p: Parameters, state: State) -> Land:
    """Return the landing here: slower below 5 m, a crawl below 1 m (FlightTaskAuto.cpp).

    PX4 crawls only with a distance sensor, as SIH has.
    """
    crawl_m = p["MPC_LAND_ALT3"]
    profile = LandProfile(
        (
            (p["MPC_LAND_ALT1"], p["MPC_Z_V_AUTO_DN"]),
            (p["MPC_LAND_ALT2"], p["MPC_LAND_SPEED"]),
            (crawl_m, p["MPC_LAND_SPEED"]),
            (crawl_m, p["MPC_LAND_CRWL"]),
        )
    )
    return Land(profile=profile, speeds=speeds(p), ground_down_m=state.home_down_m)


def return_height_m(p: Parameters, state: State) -> float:
    """Return how high above home to fly back: a cone near home (rtl.cpp, RTL_CONE_ANG)."""
    here, home = state.now.position_ned_m, state.home_ned_m or (0.0, 0.0, 0.0)
    distance_m = math.hypot(here[0] - home[0], here[1] - home[1])
    near_m, cone_deg = p["NAV_ACC_RAD"], p["RTL_CONE_ANG"]
    height_m = p["RTL_RETURN_ALT"]
    if distance_m <= near_m:
        height_m = 2.0 * distance_m
    elif cone_deg > 0.0 and distance_m <= p["RTL_MIN_DIST"]:
        cone_rad = math.radians(min(max(cone_deg, 1.0), 89.0))
        height_m = max(min(distance_m / math.tan(cone_rad), height_m), 2.0 * near_m)
    return max(height_m, home[2] - here[2])


def return_home(p: Parameters, state: State, height_m: float) -> ReturnHome:
    """Return the flight home at a height above it."""
    home = state.home_ned_m or (0.0, 0.0, 0.0)
    return ReturnHome(
        home_ned_m=home,
        return_down_m=home[2] - height_m,
        speeds=speeds(p),
        wait_s=max(0.0, p["RTL_LAND_DELAY"]),
        land=land(p, state),
    )
