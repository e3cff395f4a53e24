"""ArduCopter's automatic manoeuvres: behaviours built from its parameters and the state."""

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

_FACES_WAYPOINT = {1, 2}
"""Values of WP_YAW_BEHAVIOR that turn the nose to the next waypoint."""
_LOOKS_AHEAD, _AHEAD_FROM_M_S = 3, 1.0
"""Value of WP_YAW_BEHAVIOR that turns the nose to the motion; YAW_LOOK_AHEAD_MIN_SPEED."""
_FACE_BEYOND_M = 2.0
_FACE_SHARE = 0.05
"""Share of WPNAV_SPEED from which the nose points where it flies (calculate_yaw_and_rate_yaw)."""
_TAKEOFF_RADIUS_M = 0.22
_MIN_CLIMB_M = 2.5
"""RTL_ABS_MIN_CLIMB."""
_MIN_SLOPE = 0.5
"""RTL_MIN_CONE_SLOPE: shallower cones are ignored."""


class CopterManoeuvres(Manoeuvres):
    """ArduCopter's behaviours by WPNAV_*, LAND_* and RTL_*, which are in cm and cm/s."""

    zero_keeps_height = True

    def default_speeds(self) -> GuidanceSpeeds:
        """Return the speed limits of ArduCopter's automatic modes."""
        names = ("WPNAV_SPEED", "WPNAV_SPEED_UP", "WPNAV_SPEED_DN")
        across, up, down = map(self._metres, names)
        return speed_limits(across, up, down)

    def _metres(self, name: str) -> float:
        """Return a parameter in m or m/s that ArduCopter has in cm."""
        return self._p[name] / 100.0

    def return_speeds(self) -> GuidanceSpeeds:
        """Return the speed limits of ArduCopter's RTL, with RTL_SPEED if it is set."""
        limits = self.speeds()
        return limits._replace(across=max(0.0, self._metres("RTL_SPEED")) or limits.across)

    def return_height_m(self) -> float:
        """Return ArduCopter's return height above home (compute_return_target)."""
        distance_m, height_m = self.from_home_m()
        climb_m = max(0.0, self._metres("RTL_CLIMB_MIN"))
        target_m = max(height_m + climb_m, self._metres("RTL_ALT"))
        slope = self._p["RTL_CONE_SLOPE"]
        if slope >= _MIN_SLOPE:
            target_m = min(target_m, max(distance_m * slope, height_m + _MIN_CLIMB_M))
        return max(height_m, target_m)

    def return_wait_s(self) -> float:
        """Return how long ArduCopter loiters above home."""
        return self._p["RTL_LOIT_TIME"] / 1e3

    def return_end_m(self) -> float | None:
        """Return the height at which ArduCopter stays above home (ModeRTL::build_path)."""
        end_m = self._metres("RTL_ALT_FINAL")
        return end_m if end_m > 0.0 else None

    def land_profile(self) -> LandProfile:
        """Return ArduCopter's descent: fast above LAND_ALT_LOW, slow below."""
        fast = self._metres("LAND_SPEED_HIGH") or self._metres("WPNAV_SPEED_DN")
        low_m = self._metres("LAND_ALT_LOW")
        return LandProfile(((low_m + 0.01, fast), (low_m, self._metres("LAND_SPEED"))))

    def faces_from_m_s(self) -> float | None:
        """Return the speed from which the nose points where it flies, if no heading is given."""
        behaviour = int(self._p["WP_YAW_BEHAVIOR"])
        if behaviour == _LOOKS_AHEAD:
            return _AHEAD_FROM_M_S
        return _FACE_SHARE * self.speeds().across if behaviour in _FACES_WAYPOINT else None

    def take_off(self, down_m: float) -> TakeOffBehaviour:
        """Return ArduCopter's climb to a local height."""
        limits = self.speeds()
        return TakeOffBehaviour(
            down_m=down_m,
            climb_m_s=limits.up,
            ramp_s=0.0,
            radius_m=_TAKEOFF_RADIUS_M,
            speeds=limits,
        )

    def waypoint(self, position_ned_m: Vec3, *, yaw_deg: float) -> GoToBehaviour:
        """Return ArduCopter's flight to a place of a mission, whose heading it does not use."""
        del yaw_deg
        return self.go_to(position_ned_m, radius_m=self._metres("WPNAV_RADIUS"))

    def go_to(self, position_ned_m: Vec3, *, radius_m: float) -> GoToBehaviour:
        """Return ArduCopter's flight to a place, facing it when it is farther than 2 m."""
        here, yaw_rad = self._state.now.position_ned_m, self._state.now.euler_rad[2]
        north, east = position_ned_m[0] - here[0], position_ned_m[1] - here[1]
        faces = int(self._p["WP_YAW_BEHAVIOR"]) in _FACES_WAYPOINT
        if faces and math.hypot(north, east) > _FACE_BEYOND_M:
            yaw_rad = math.atan2(east, north)
        return GoToBehaviour(
            position_ned_m=position_ned_m,
            yaw_rad=yaw_rad,
            speeds=self.speeds(),
            radius_m=radius_m,
        )
