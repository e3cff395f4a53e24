"""Fly ahead to a place, round what a depth camera sees on the way.

Of the headings the one is taken that leads nearest to the place, keeps its distance, and does not
change its mind: the costs of VFH+ (Ulrich and Borenstein, ICRA 1998). The vehicle looks where it
flies: it turns first, and is as fast as it can still stop in what it sees to be free.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from campaigns.api import (
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
from campaigns.autonomies.obstacle_map import ObstacleMap, free_ways
from campaigns.autonomies.parameters import goal_altitude_m, read_parameters

_OWNER = "detour autonomy"
_HEIGHT_GAIN = 1.2
_HEIGHT_M_S = 0.6
_ARRIVED_M = 0.3
_STANDING_M_S = 0.2
_REACTION_S = 0.5
"""From a command to the speed that it asks for, and the age of a depth image."""
_LOOKS_RAD = math.radians(25.0)
"""How far beside the camera's axis a way may lead to be flown at once."""
_LONGEST_TURN_S = 0.2


@dataclass(frozen=True, slots=True)
class DetourParameters:
    """The parameters of flights round obstacles: what may stand under `with`.

    ahead_m: how far ahead of the start the place is. speed_m_s, acceleration_m_s2: of the flight.
    look_m: how far it looks. least_m: what is nearer to the middle of the vehicle closes a way;
    keep_m: what is nearer makes it a worse one. shy: how much worse, in radians of detour.
    memory_s: how long it remembers what it saw. half_height_m: how far above and below it things
    are in its way. for_s: then it gives up. camera_stabilized: a gimbal keeps the camera level.
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
        chosen = read_parameters(DetourParameters, parameters, _OWNER, may_be_zero=frozenset())
        if chosen.keep_m < chosen.least_m:
            raise ValueError(f"{_OWNER}: keep_m must be at least least_m, {chosen.least_m:g}")
        self._set = chosen
        self._altitude_m = goal_altitude_m(goal, _OWNER)
        self._map = ObstacleMap(chosen.look_m, chosen.half_height_m, chosen.memory_s)
        self._history = PoseHistory(2.0, max_gap_s=0.6, max_prediction_s=0.1)
        self._began_s: float | None = None
        self._last_s = 0.0
        self._place = (0.0, 0.0)
        self._heading_rad = 0.0
        self._speed_m_s = 0.0

    def perceive(self, reading: Reading) -> None:
        """Note what a depth image shows; other readings are ignored."""
        if not isinstance(reading, DepthReading):
            return
        pose = self._history.at(reading.t_s).pose
        if pose is not None:
            level = quat_from_euler(0.0, 0.0, pose.yaw_rad)
            camera = level if self._set.camera_stabilized else pose.q_wxyz
            self._map.look(reading, pose, camera)

    def act(self, telemetry: Telemetry) -> Command:
        """Return the velocity setpoint along the best way, facing it."""
        self._history.add(telemetry.t_s, telemetry.pose, telemetry.velocity_ned_m_s)
        now_s, pose = telemetry.t_s, telemetry.pose
        if self._began_s is None:
            self._begin(now_s, pose)
        dt_s = min(max(now_s - self._last_s, 0.0), _LONGEST_TURN_S)
        self._last_s = now_s
        left = np.array(self._place) - np.array(pose.position_ned_m[:2])
        left_m = float(np.hypot(*left))
        gave_up = now_s - (self._began_s or 0.0) >= self._set.for_s
        if left_m <= _ARRIVED_M or gave_up:
            return self._stop(telemetry, gave_up=gave_up and left_m > _ARRIVED_M)
        wanted_m_s, is_free = self._choose(telemetry, math.atan2(left[1], left[0]), left_m)
        rise_m_s = self._set.acceleration_m_s2 * dt_s
        self._speed_m_s = min(wanted_m_s, self._speed_m_s + rise_m_s)
        note = "ahead" if is_free else "blocked"
        return Command(self._setpoint(pose, self._speed_m_s), note=note)

    def _begin(self, now_s: float, pose: Pose) -> None:
        """Set the place: ahead of where and how the vehicle stands."""
        self._began_s = self._last_s = now_s
        self._heading_rad = pose.yaw_rad
        north, east, _ = pose.position_ned_m
        ahead_m = self._set.ahead_m
        self._place = (
            north + ahead_m * math.cos(pose.yaw_rad),
            east + ahead_m * math.sin(pose.yaw_rad),
        )

    def _choose(self, telemetry: Telemetry, goal_rad: float, left_m: float) -> tuple[float, bool]:
        """Take the best heading; return the speed along it, and whether there is a free one."""
        chosen = self._set
        within_m = min(chosen.look_m, left_m)
        offsets = self._map.offsets(telemetry.pose, telemetry.t_s)
        ways = free_ways(offsets, least_m=chosen.least_m, within_m=within_m)
        away = np.abs(_wrapped(ways.headings_rad - goal_rad))
        turned = np.abs(_wrapped(ways.headings_rad - self._heading_rad))
        room = np.clip(
            (ways.beside_m - chosen.least_m) / max(chosen.keep_m - chosen.least_m, 1e-6), 0.0, 1.0
        )
        # A way that ends early is no way at all unless every one does.
        closed = 1.0 - np.minimum(ways.ahead_m / within_m, 1.0)
        cost = away + 0.4 * turned + chosen.shy * (1.0 - room) + 4.0 * closed
        best = int(np.argmin(cost))
        self._heading_rad = float(ways.headings_rad[best])
        if away.min() == away[best] and room[best] >= 1.0:
            self._heading_rad = goal_rad  # no detour: not along the nearest of the 72
        beside_rad = abs(wrap_pi(self._heading_rad - telemetry.pose.yaw_rad))
        free_m = min(float(ways.ahead_m[best]), left_m)
        if beside_rad > _LOOKS_RAD:
            return 0.0, free_m > 0.0
        return min(chosen.speed_m_s, self._stoppable(free_m)), free_m > 0.0

    def _stoppable(self, way_m: float) -> float:
        """Return the speed v that stops in time: way = v _REACTION_S + v^2 / 2a."""
        a_m_s2 = self._set.acceleration_m_s2
        lost_m_s = a_m_s2 * _REACTION_S
        return math.sqrt(lost_m_s * lost_m_s + 2.0 * a_m_s2 * max(0.0, way_m)) - lost_m_s

    def _stop(self, telemetry: Telemetry, *, gave_up: bool) -> Command:
        self._speed_m_s = 0.0
        stands = math.hypot(*telemetry.velocity_ned_m_s) < _STANDING_M_S
        note = "gave up" if gave_up else "stop"
        return Command(self._setpoint(telemetry.pose, 0.0), done=stands, note=note)

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
