"""Fly to a place ahead, round the obstacles that a depth camera sees.

The cost of a heading is its deviation from the goal, its change, and the nearness of obstacles, as
in VFH+ (Ulrich and Borenstein, ICRA 1998). The vehicle looks where it flies: it turns first, and is
so fast that it can still stop within the free way that it sees.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from wil_campaign.api import (
    Command,
    DepthReading,
    Pose,
    PoseHistory,
    Reading,
    Telemetry,
    Vec3,
    VelocitySetpoint,
    quat_from_euler,
    wrap_pi,
)

from .braking import stopping_speed
from .obstacle_map import ObstacleMap, free_ways
from .parameters import goal_altitude_m, read_autonomy_parameters

_OWNER = "detour autonomy"
_HEIGHT_GAIN = 1.2
_HEIGHT_M_S = 0.6
_ARRIVED_M = 0.3
_STANDING_M_S = 0.2
_REACTION_S = 0.5
"""Delay from a command until the vehicle has its speed, plus the age of a depth image."""
_IN_VIEW_RAD = math.radians(25.0)
"""Largest angle between a way and the camera's axis; beyond it the vehicle turns first."""
_LONGEST_STEP_S = 0.2


@dataclass(frozen=True, slots=True)
class DetourParameters:
    """The parameters of flights round obstacles: the keys of `with`.

    ahead_m: distance of the place ahead of the start. speed_m_s, acceleration_m_s2: of the flight.
    look_m: range of the obstacle map. least_m: an obstacle nearer than this to the middle of the
    vehicle closes a way; keep_m: one nearer than this adds a cost, of up to `shy` radians of
    detour. memory_s: how long obstacles are remembered. half_height_m: obstacles up to so far above
    and below the vehicle count. for_s: time after which it gives up. camera_stabilized: a gimbal
    keeps the camera level.
    """

    ahead_m: float = 20.0
    speed_m_s: float = 1.5
    acceleration_m_s2: float = 1.5
    look_m: float = 6.0
    least_m: float = 0.8
    keep_m: float = 2.0
    shy: float = 1.2
    memory_s: float = 20.0
    half_height_m: float = 0.5
    for_s: float = 60.0
    camera_stabilized: bool = False


class DetourAutonomy:
    """The shipped autonomy `detour`: flies to a place ahead, round what its depth camera sees."""

    def __init__(
        self, *, goal: Mapping[str, float | str], parameters: Mapping[str, object], seed: int
    ) -> None:
        """Raise ValueError on unknown detour parameters, or ones of the wrong type.

        parameters: those of DetourParameters. goal: altitude_m. seed: unused.
        """
        del seed
        own = self._parameters = read_autonomy_parameters(DetourParameters, parameters, _OWNER)
        if own.keep_m < own.least_m:
            raise ValueError(f"{_OWNER}: keep_m must be at least least_m, {own.least_m:g}")
        self._altitude_m = goal_altitude_m(goal, _OWNER)
        self._map = ObstacleMap(own.look_m, own.half_height_m, own.memory_s)
        self._history = PoseHistory(2.0, max_gap_s=0.6, max_prediction_s=0.1)
        self._began_s: float | None = None
        self._last_s = 0.0
        self._place = (0.0, 0.0)
        self._heading_rad = 0.0
        self._speed_m_s = 0.0

    def perceive(self, reading: Reading) -> None:
        """Add a depth image to the obstacle map; other readings are ignored."""
        if not isinstance(reading, DepthReading):
            return
        pose = self._history.at(reading.t_s).pose
        if pose is not None:
            level = quat_from_euler(0.0, 0.0, pose.yaw_rad)
            camera = level if self._parameters.camera_stabilized else pose.q_wxyz
            self._map.add(reading, pose, camera)

    def act(self, telemetry: Telemetry) -> Command:
        """Return the velocity setpoint along the best way, facing it."""
        self._history.add(telemetry.t_s, telemetry.pose, telemetry.velocity_ned_m_s)
        now_s, pose = telemetry.t_s, telemetry.pose
        if self._began_s is None:
            self._begin(now_s, pose)
        dt_s = min(max(now_s - self._last_s, 0.0), _LONGEST_STEP_S)
        self._last_s = now_s
        rest = np.array(self._place) - np.array(pose.position_ned_m[:2])
        rest_m = float(np.hypot(*rest))
        gave_up = now_s - (self._began_s or 0.0) >= self._parameters.for_s
        if rest_m <= _ARRIVED_M or gave_up:
            return self._stop(telemetry, gave_up=gave_up and rest_m > _ARRIVED_M)
        wanted_m_s, is_free = self._choose(telemetry, math.atan2(rest[1], rest[0]), rest_m)
        rise_m_s = self._parameters.acceleration_m_s2 * dt_s
        self._speed_m_s = min(wanted_m_s, self._speed_m_s + rise_m_s)
        note = "ahead" if is_free else "blocked"
        return Command(self._setpoint(pose, self._speed_m_s), note=note)

    def _begin(self, now_s: float, pose: Pose) -> None:
        """Set the place: ahead of the vehicle's pose."""
        self._began_s = self._last_s = now_s
        self._heading_rad = pose.yaw_rad
        north, east, _ = pose.position_ned_m
        ahead_m = self._parameters.ahead_m
        self._place = (
            north + ahead_m * math.cos(pose.yaw_rad),
            east + ahead_m * math.sin(pose.yaw_rad),
        )

    def _choose(self, telemetry: Telemetry, goal_rad: float, rest_m: float) -> tuple[float, bool]:
        """Choose the best heading; return the speed along it, and whether there is a free one."""
        own = self._parameters
        within_m = min(own.look_m, rest_m)
        offsets = self._map.offsets(telemetry.pose, telemetry.t_s)
        ways = free_ways(offsets, least_m=own.least_m, within_m=within_m)
        away = np.abs(_wrapped(ways.headings_rad - goal_rad))
        turned = np.abs(_wrapped(ways.headings_rad - self._heading_rad))
        room = np.clip(
            (ways.beside_m - own.least_m) / max(own.keep_m - own.least_m, 1e-6), 0.0, 1.0
        )
        # A way that is blocked early is chosen only if all of them are.
        closed = 1.0 - np.minimum(ways.ahead_m / within_m, 1.0)
        cost = away + 0.4 * turned + own.shy * (1.0 - room) + 4.0 * closed
        best = int(np.argmin(cost))
        self._heading_rad = float(ways.headings_rad[best])
        if away.min() == away[best] and room[best] >= 1.0:
            self._heading_rad = goal_rad  # the exact heading instead of the nearest of the 72
        free_m = min(float(ways.ahead_m[best]), rest_m)
        if abs(wrap_pi(self._heading_rad - telemetry.pose.yaw_rad)) > _IN_VIEW_RAD:
            return 0.0, free_m > 0.0
        stopping_m_s = stopping_speed(
            free_m, acceleration_m_s2=own.acceleration_m_s2, reaction_s=_REACTION_S
        )
        return min(own.speed_m_s, stopping_m_s), free_m > 0.0

    def _stop(self, telemetry: Telemetry, *, gave_up: bool) -> Command:
        self._speed_m_s = 0.0
        is_standing = math.hypot(*telemetry.velocity_ned_m_s) < _STANDING_M_S
        note = "gave up" if gave_up else "stop"
        return Command(self._setpoint(telemetry.pose, 0.0), done=is_standing, note=note)

    def _setpoint(self, pose: Pose, speed_m_s: float) -> VelocitySetpoint:
        down_m = -self._altitude_m - pose.position_ned_m[2]
        down_m_s = max(-_HEIGHT_M_S, min(_HEIGHT_M_S, _HEIGHT_GAIN * down_m))
        velocity: Vec3 = (
            speed_m_s * math.cos(self._heading_rad),
            speed_m_s * math.sin(self._heading_rad),
            down_m_s,
        )
        return VelocitySetpoint(velocity, yaw_rad=self._heading_rad)


def _wrapped(angles_rad: np.ndarray) -> np.ndarray:
    wrapped: np.ndarray = (angles_rad + math.pi) % (2.0 * math.pi) - math.pi
    return wrapped
