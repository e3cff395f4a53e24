"""ArduCopter's simple avoidance: limits velocities before obstacles of a MAVLink proximity sensor.

As in AC_Avoid.cpp (adjust_velocity_proximity, slide), AP_Proximity_MAV.cpp and
AP_Proximity_Boundary_3D.cpp of 4.6: eight faces of 45 degrees keep the nearest distance for one
second, filtered at PRX_FILT (0.25 Hz: 0.6 s late). The boundary runs between the edges of the
faces; the velocity towards it is limited so that the vehicle can stop at AVOID_MARGIN. Not
emulated: sliding along fences, backing away (AVOID_BACKUP_SPD), AVOID_ACCEL_MAX, other layers.
"""

import math
from collections.abc import Iterator
from typing import Any

from wil_campaign.vehicles.embedded.autopilot.flight.parameter_table import ParameterTable
from wil_campaign.worlds.frames import Vec3

_MAVLINK = 2
"""PRX1_TYPE."""
_USE_PROXIMITY = 2
"""Bit of AVOID_ENABLE."""
_TIMEOUT_S = 0.5
"""PROXIMITY_MAV_TIMEOUT_MS: of the sensor, for arming."""
_FACE_S = 1.0
"""PROXIMITY_FACE_RESET_MS, PROXIMITY_FILT_RESET_TIME: of a distance."""
_NEAREST_M = 0.6
"""PROXIMITY_BOUNDARY_DIST_MIN."""
_FACES = 8
_FACE_RAD = math.radians(45.0)
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


class _Face:
    """One face of the boundary: the nearest object in 45 degrees."""

    def __init__(self) -> None:
        self.measured: Obstacle = (0.0, math.inf)
        self.filtered_m = math.inf
        self.is_valid = False
        self._at_s = -math.inf

    def measure(self, nearest: Obstacle | None, t_s: float, cutoff_hz: float) -> None:
        """Take the nearest object in the face now; None for none."""
        self.is_valid = nearest is not None
        if nearest is None:
            return
        elapsed_s = t_s - self._at_s
        delay_s = 1.0 / (math.tau * cutoff_hz) if cutoff_hz > 0.0 else 0.0
        self.measured, self._at_s = nearest, t_s
        if elapsed_s >= _FACE_S or delay_s == 0.0:
            self.filtered_m = nearest[1]
        else:
            share = elapsed_s / (elapsed_s + delay_s)
            self.filtered_m += share * (nearest[1] - self.filtered_m)

    def is_known(self, t_s: float) -> bool:
        """Return whether the face has a distance that is not too old."""
        return self.is_valid and t_s - self._at_s <= _FACE_S


class SimpleAvoidance:
    """ArduCopter's simple avoidance: stores reported obstacles, limits velocities by them."""

    def __init__(self, parameters: ParameterTable) -> None:
        self._parameters = parameters
        # PRX1_TYPE takes effect only after a reboot.
        self.listens = int(parameters["PRX1_TYPE"]) == _MAVLINK
        self._faces = tuple(_Face() for _ in range(_FACES))
        self._received_s = -math.inf

    def obstacle_distance(self, message: Any, t_s: float) -> None:
        """Store an OBSTACLE_DISTANCE for avoidance."""
        step_deg = message.increment_f or float(message.increment)
        if step_deg == 0.0 or not math.isfinite(step_deg + message.angle_offset):
            return
        self._received_s = t_s
        nearest: dict[int, Obstacle] = {}
        for k, cm in enumerate(message.distances):
            if not max(1, message.min_distance) <= cm <= message.max_distance:
                continue
            bearing_rad = math.radians(message.angle_offset + k * step_deg)
            sector, distance_m = _face_at(bearing_rad), cm / 100.0
            if sector not in nearest or distance_m < nearest[sector][1]:
                nearest[sector] = (bearing_rad, distance_m)
        for index, face in enumerate(self._faces):
            face.measure(nearest.get(index), t_s, self._parameters["PRX_FILT"])

    def distance_sensor(self, message: Any, t_s: float) -> None:
        """Store a sideways DISTANCE_SENSOR for avoidance."""
        if message.orientation >= _SIDEWAYS:
            return
        self._received_s = t_s
        seen = message.min_distance <= message.current_distance <= message.max_distance
        bearing_rad = message.orientation * _FACE_RAD
        nearest = (bearing_rad, message.current_distance / 100.0) if seen else None
        self._faces[message.orientation].measure(nearest, t_s, self._parameters["PRX_FILT"])

    def lacks_data(self, t_s: float) -> bool:
        """Return whether the sensor is silent: ArduPilot's pre-arm check fails then."""
        return self.listens and t_s - self._received_s > _TIMEOUT_S

    def arming_fault(self, t_s: float) -> str | None:
        """Return ArduPilot's text for a sensor that is silent, or an obstacle too near; or None."""
        if not self.listens:
            return None
        if self.lacks_data(t_s):
            return NO_DATA
        known = (face for face in self._faces if face.is_known(t_s))
        nearest = min(known, key=lambda face: face.filtered_m, default=None)
        if nearest is None or nearest.filtered_m > _NEAR_AT_ARMING_M:
            return None
        bearing_deg, distance_m = math.degrees(nearest.measured[0]), nearest.filtered_m
        return f"Proximity {bearing_deg:.0f} deg, {distance_m:.2f}m (want > {_NEAR_AT_ARMING_M}m)"

    def limited(self, velocity_ned_m_s: Vec3, yaw_rad: float, t_s: float) -> Vec3:
        """Return the velocity that avoidance allows."""
        if not (self.listens and int(self._parameters["AVOID_ENABLE"]) & _USE_PROXIMITY):
            return velocity_ned_m_s
        north, east, down = velocity_ned_m_s
        margin_m = self._parameters["AVOID_MARGIN"]
        for bearing_rad, distance_m in self._boundary(t_s):
            to_north, to_east = math.cos(yaw_rad + bearing_rad), math.sin(yaw_rad + bearing_rad)
            towards = north * to_north + east * to_east
            speed = math.sqrt(north**2 + east**2 + down**2)
            kept_m = margin_m * math.hypot(north, east) / speed if speed else margin_m
            most = avoidance_stopping_speed(max(0.0, distance_m - kept_m))
            if towards > most:
                north -= (towards - most) * to_north
                east -= (towards - most) * to_east
        return (north, east, down)

    def _boundary(self, t_s: float) -> Iterator[Obstacle]:
        """Yield the nearest point of each side of the boundary: from edge to edge of a face.

        An edge is as far as the nearer of its two faces; beside a face without a distance it is as
        far as the next edge.
        """
        known = [face.is_known(t_s) for face in self._faces]
        edges: list[float | None] = []
        for before in range(_FACES):
            after = (before + 1) % _FACES
            faces = [self._faces[one].filtered_m for one in (before, after) if known[one]]
            edges.append(max(_NEAREST_M, min(faces)) if faces else None)
        for index in (*range(1, _FACES), 0):
            start, end = edges[index - 1], edges[index]
            if (nearest_m := _nearest(start, end)) is not None:
                yield (index * _FACE_RAD + nearest_m[0], nearest_m[1])


def _face_at(bearing_rad: float) -> int:
    """Return the index of the face of a bearing (radians to the right of forward)."""
    return int(((bearing_rad + _FACE_RAD / 2.0) % math.tau) / _FACE_RAD) % _FACES


def _nearest(start_m: float | None, end_m: float | None) -> Obstacle | None:
    """Return the nearest point between two edges of a face: bearing from its middle, distance.

    None where neither edge has a distance; an edge without one is as far as the other.
    """
    first_m, last_m = start_m if start_m is not None else end_m, end_m or start_m
    if first_m is None or last_m is None:
        return None
    half_rad = _FACE_RAD / 2.0
    ahead = (first_m * math.cos(half_rad), last_m * math.cos(half_rad))
    right = (-first_m * math.sin(half_rad), last_m * math.sin(half_rad))
    along = (ahead[1] - ahead[0], right[1] - right[0])
    length2 = along[0] ** 2 + along[1] ** 2
    share = -(ahead[0] * along[0] + right[0] * along[1]) / length2
    share = min(1.0, max(0.0, share))
    x, y = ahead[0] + share * along[0], right[0] + share * along[1]
    return (math.atan2(y, x), math.hypot(x, y))


def avoidance_stopping_speed(distance_m: float) -> float:
    """Return the speed from which avoidance stops within a distance (sqrt_controller).

    Linear for small distances, a square root beyond.
    """
    linear_m = _BRAKING_M_S2 / _POSITION_GAIN**2
    if distance_m <= linear_m:
        return _POSITION_GAIN * distance_m
    return math.sqrt(2.0 * _BRAKING_M_S2 * (distance_m - linear_m / 2.0))
