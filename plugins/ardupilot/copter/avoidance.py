"""ArduCopter's simple avoidance: limits velocities before obstacles of a MAVLink proximity sensor.

As in AC_Avoid.cpp (limit_velocity_2D) and AP_Proximity_MAV.cpp: obstacles over MAVLink are valid
for 500 ms; the velocity towards each is limited so that the vehicle can stop at AVOID_MARGIN. Not
emulated: sliding along fences, backing away (AVOID_BACKUP_SPD), OBSTACLE_DISTANCE_3D.
"""

import math
from typing import Any

from wil_campaign.vehicles.embedded.autopilot.flight.parameter_table import ParameterTable
from wil_campaign.worlds.frames import Vec3

_MAVLINK = 2
"""PRX1_TYPE."""
_USE_PROXIMITY = 2
"""Bit of AVOID_ENABLE."""
_TIMEOUT_S = 0.5
_SECTOR_RAD = math.radians(45.0)
_SIDEWAYS = 8
"""MAV_SENSOR_ROTATION_NONE to YAW_315 are 0 to 7, clockwise."""
_POSITION_GAIN = 1.0
"""PSC_NE_POS_P."""
_BRAKING_M_S2 = 2.5
"""WPNAV_ACCEL of 250."""
_NEAR_AT_ARMING_M = 0.6
NO_DATA = "PRX1: No Data"

Obstacle = tuple[float, float]
"""Bearing in the body's frame (radians to the right of forward), and distance in metres."""


class SimpleAvoidance:
    """ArduCopter's simple avoidance: stores reported obstacles, limits velocities by them."""

    def __init__(self, parameters: ParameterTable) -> None:
        self._parameters = parameters
        # PRX1_TYPE takes effect only after a reboot.
        self.listens = int(parameters["PRX1_TYPE"]) == _MAVLINK
        self._rings: dict[str, tuple[float, tuple[Obstacle, ...]]] = {}

    def obstacle_distance(self, message: Any, t_s: float) -> None:
        """Store an OBSTACLE_DISTANCE for avoidance."""
        step_deg = message.increment_f or float(message.increment)
        if not math.isfinite(step_deg + message.angle_offset):
            return
        obstacles = tuple(
            (math.radians(message.angle_offset + k * step_deg), cm / 100.0)
            for k, cm in enumerate(message.distances)
            if message.min_distance <= cm <= message.max_distance
        )
        self._rings["ring"] = (t_s, obstacles)

    def distance_sensor(self, message: Any, t_s: float) -> None:
        """Store a sideways DISTANCE_SENSOR for avoidance."""
        if message.orientation >= _SIDEWAYS:
            return
        seen = message.min_distance <= message.current_distance <= message.max_distance
        bearing_rad = message.orientation * _SECTOR_RAD
        obstacles = ((bearing_rad, message.current_distance / 100.0),) if seen else ()
        self._rings[f"sector {message.orientation}"] = (t_s, obstacles)

    def lacks_data(self, t_s: float) -> bool:
        """Return whether the sensor is silent: ArduPilot's pre-arm check fails then."""
        return self.listens and not any(
            t_s - since_s <= _TIMEOUT_S for since_s, _ in self._rings.values()
        )

    def arming_fault(self, t_s: float) -> str | None:
        """Return ArduPilot's text for a sensor that is silent, or an obstacle too near; or None."""
        if self.lacks_data(t_s):
            return NO_DATA
        nearest = min(self._known_distances(t_s), key=lambda each: each[1], default=None)
        if nearest is None or nearest[1] > _NEAR_AT_ARMING_M:
            return None
        bearing_deg, distance_m = math.degrees(nearest[0]), nearest[1]
        return f"Proximity {bearing_deg:.1f} deg, {distance_m:.1f}m (want > {_NEAR_AT_ARMING_M}m)"

    def limited(self, velocity_ned_m_s: Vec3, yaw_rad: float, t_s: float) -> Vec3:
        """Return the velocity that avoidance allows."""
        if not int(self._parameters["AVOID_ENABLE"]) & _USE_PROXIMITY:
            return velocity_ned_m_s
        north, east, down = velocity_ned_m_s
        margin_m = self._parameters["AVOID_MARGIN"]
        for bearing_rad, distance_m in self._known_distances(t_s):
            to_north, to_east = math.cos(yaw_rad + bearing_rad), math.sin(yaw_rad + bearing_rad)
            towards = north * to_north + east * to_east
            most = avoidance_stopping_speed(max(0.0, distance_m - margin_m))
            if towards > most:
                north -= (towards - most) * to_north
                east -= (towards - most) * to_east
        return (north, east, down)

    def _known_distances(self, t_s: float) -> list[Obstacle]:
        if not self.listens:
            return []
        rings = (ring for since_s, ring in self._rings.values() if t_s - since_s <= _TIMEOUT_S)
        return [obstacle for ring in rings for obstacle in ring]


def avoidance_stopping_speed(distance_m: float) -> float:
    """Return the speed from which avoidance stops within a distance (sqrt_controller).

    Linear for small distances, a square root beyond.
    """
    linear_m = _BRAKING_M_S2 / _POSITION_GAIN**2
    if distance_m <= linear_m:
        return _POSITION_GAIN * distance_m
    return math.sqrt(2.0 * _BRAKING_M_S2 * (distance_m - linear_m / 2.0))
