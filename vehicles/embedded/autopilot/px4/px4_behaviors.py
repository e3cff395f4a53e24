"""PX4's automatic manoeuvres: behaviours built from its parameters and the state."""

import math

from wil_campaign.vehicles.embedded.autopilot.flight.guidance import (
    GoToBehaviour,
    GuidanceSpeeds,
    LandProfile,
    TakeOffBehaviour,
    speed_limits,
)
from wil_campaign.vehicles.embedded.autopilot.flight.manoeuvres import Manoeuvres
from wil_campaign.worlds.frames import Vec3

_RADIUS_M = 0.3


class Px4Manoeuvres(Manoeuvres):
    """PX4's behaviours by MPC_*, MIS_*, NAV_* and RTL_*."""

    def change_speed(self, kind: float, speed_m_s: float) -> bool:
        """Execute DO_CHANGE_SPEED; without a speed PX4 restores its own (navigator_main.cpp)."""
        if not super().change_speed(kind, speed_m_s):
            self.forget_speeds()
        return True

    def default_speeds(self) -> GuidanceSpeeds:
        """Return the speed limits of PX4's automatic modes."""
        p = self._p
        return speed_limits(p["MPC_XY_CRUISE"], p["MPC_Z_V_AUTO_UP"], p["MPC_Z_V_AUTO_DN"])

    def offboard_speeds(self) -> GuidanceSpeeds:
        """Return the speed limits of PX4's OFFBOARD."""
        p = self._p
        return speed_limits(p["MPC_XY_VEL_MAX"], p["MPC_Z_VEL_MAX_UP"], p["MPC_Z_VEL_MAX_DN"])

    def return_speeds(self) -> GuidanceSpeeds:
        """Return the speed limits of PX4's automatic modes, for its return."""
        return self.speeds()

    def return_height_m(self) -> float:
        """Return PX4's return height above home: a cone (rtl.cpp, RTL_CONE_ANG)."""
        p = self._p
        distance_m, above_m = self.from_home_m()
        near_m, cone_deg = p["NAV_ACC_RAD"], p["RTL_CONE_ANG"]
        height_m = p["RTL_RETURN_ALT"]
        if distance_m <= near_m:
            height_m = 2.0 * distance_m
        elif cone_deg > 0.0 and distance_m <= p["RTL_MIN_DIST"]:
            cone_rad = math.radians(min(max(cone_deg, 1.0), 89.0))
            height_m = max(min(distance_m / math.tan(cone_rad), height_m), 2.0 * near_m)
        return max(height_m, above_m)

    def return_wait_s(self) -> float:
        """Return how long PX4 loiters above home; forever when RTL_LAND_DELAY is negative."""
        delay_s = self._p["RTL_LAND_DELAY"]
        return delay_s if delay_s >= 0.0 else math.inf

    def land_profile(self) -> LandProfile:
        """Return PX4's descent: slower below 5 m, a crawl below 1 m.

        PX4 crawls only with a distance sensor, as SIH has.
        """
        p = self._p
        crawl_m = p["MPC_LAND_ALT3"]
        return LandProfile(
            (
                (p["MPC_LAND_ALT1"], p["MPC_Z_V_AUTO_DN"]),
                (p["MPC_LAND_ALT2"], p["MPC_LAND_SPEED"]),
                (crawl_m, p["MPC_LAND_SPEED"]),
                (crawl_m, p["MPC_LAND_CRWL"]),
            )
        )

    def take_off(self, down_m: float) -> TakeOffBehaviour:
        """Return PX4's climb to a height, no lower than the present one."""
        p = self._p
        return TakeOffBehaviour(
            down_m=min(down_m, self._state.now.position_ned_m[2]),
            climb_m_s=p["MPC_TKO_SPEED"],
            ramp_s=p["MPC_TKO_RAMP_T"],
            radius_m=p["NAV_MC_ALT_RAD"],
            speeds=self.speeds(),
        )

    def waypoint(self, position_ned_m: Vec3, *, yaw_deg: float) -> GoToBehaviour:
        """Return PX4's flight to a place of a mission, with its item's heading.

        Without one it faces a place beyond NAV_ACC_RAD, as MPC_YAW_MODE 0 does.
        """
        here, yaw_rad = self._state.now.position_ned_m, math.radians(yaw_deg)
        north, east = position_ned_m[0] - here[0], position_ned_m[1] - here[1]
        if not math.isfinite(yaw_rad) and math.hypot(north, east) > self._p["NAV_ACC_RAD"]:
            yaw_rad = math.atan2(east, north)
        return self.go_to(position_ned_m, yaw_rad=yaw_rad)

    def staying_yaw_rad(self, yaw_deg: float) -> float:
        """Return the heading of PX4's mission item, else the present one."""
        own_rad = super().staying_yaw_rad(yaw_deg)
        return math.radians(yaw_deg) if math.isfinite(yaw_deg) else own_rad

    def go_to(
        self, position_ned_m: Vec3, *, speed_m_s: float = -1.0, yaw_rad: float = math.nan
    ) -> GoToBehaviour:
        """Return PX4's flight to a place. speed_m_s: below 0 the usual; yaw NaN: keep it."""
        limits = self.speeds()
        return GoToBehaviour(
            position_ned_m=position_ned_m,
            yaw_rad=yaw_rad if math.isfinite(yaw_rad) else self._state.now.euler_rad[2],
            speeds=limits._replace(across=speed_m_s) if speed_m_s > 0.0 else limits,
            radius_m=_RADIUS_M,
        )
