"""Fly through a gate that the camera sees: the autonomy of the paper's first scenario.

"The subsystem works by identifying the gate and navigates the quadrotor towards the center of the
gate's mass using a PID controller" (section IV), through it, and stops. It is told the colour, not
the size or the place. The course is the heading at the start; the vehicle keeps that heading,
and moves sideways and up or down onto the line through the gate's centre while it flies ahead.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from campaigns.api import (
    NAMED_COLORS,
    BlobFinder,
    CameraReading,
    Command,
    Pose,
    PoseHistory,
    Reading,
    Telemetry,
    Vec3,
    VelocitySetpoint,
    quat_from_euler,
    subtract,
)
from campaigns.autonomies.gate_parameters import parse_goal, parse_parameters
from campaigns.autonomies.gate_sight import View, sight_of
from campaigns.autonomies.gate_track import GateTrack
from campaigns.autonomies.pid import Gains, Pid

Phase = Literal["search", "approach", "through", "stop"]

LONGEST_TURN_S = 0.2
"""Time between two commands that counts for integral and acceleration; more is a gap."""

REACTION_S = 0.4
"""From a command to the speed that it asks for: a multicopter leans before it brakes."""

ARRIVED_M = 0.05
STANDING_M_S = 0.2


@dataclass(frozen=True, slots=True)
class _Place:
    """The vehicle's place (m) and velocity (m/s) in the gate frame: ahead, right, down."""

    t_s: float
    at_m: Vec3
    velocity_m_s: Vec3


class GateAutonomy:
    """The shipped gate autonomy: finds the gate, flies through its middle, stops behind it."""

    def __init__(
        self, *, goal: Mapping[str, float | str], parameters: Mapping[str, object], seed: int
    ) -> None:
        """Raise ValueError on unknown gate parameters, or ones of the wrong type.

        parameters: those of GateParameters. goal: altitude_m above the world's ground, to search
        at; the rest of it is for the judge. seed: unused, nothing is left to chance.
        """
        del seed
        self._set = parse_parameters(parameters)
        self._altitude_m = parse_goal(goal)
        self._finder = BlobFinder(NAMED_COLORS[self._set.color])
        self._history = PoseHistory(2.0, max_gap_s=0.6, max_prediction_s=0.1)
        gains = Gains(self._set.kp, self._set.ki, self._set.kd, self._set.side_speed_m_s)
        self._side, self._height = Pid(gains), Pid(gains)
        self._phase: Phase = "search"
        self._start: Pose | None = None
        self._since_s = 0.0
        self._hold_m: Vec3 = (0.0, 0.0, 0.0)
        self._track = GateTrack(0.0, 0.0)
        self._ahead_m_s = 0.0
        self._done = False
        self._last_s: float | None = None

    def perceive(self, reading: Reading) -> None:
        """Look for the gate in an image; other readings, and early images, are ignored."""
        if not isinstance(reading, CameraReading) or self._start is None or self._phase == "stop":
            return
        pose = self._history.at(reading.t_s).pose
        blob = self._finder.find(reading.image_bgr) if pose is not None else None
        if pose is None or blob is None:
            return
        q_wxyz = pose.q_wxyz
        if self._set.camera_stabilized:
            q_wxyz = quat_from_euler(0.0, 0.0, pose.yaw_rad)
        view = View(reading.intrinsics, q_wxyz, self._start.yaw_rad)
        at_m = self._in_flight_frame(subtract(pose.position_ned_m, self._start.position_ned_m))
        self._track.update(sight_of(blob, view), at_m, reading.t_s)

    def act(self, telemetry: Telemetry) -> Command:
        """Return the velocity setpoint towards, or through, the gate."""
        self._history.add(telemetry.t_s, telemetry.pose, telemetry.velocity_ned_m_s)
        if self._start is None:
            self._begin(telemetry)
        start = self._start or telemetry.pose
        place = _Place(
            telemetry.t_s,
            self._in_flight_frame(subtract(telemetry.pose.position_ned_m, start.position_ned_m)),
            self._in_flight_frame(telemetry.velocity_ned_m_s),
        )
        elapsed_s = telemetry.t_s - (self._last_s if self._last_s is not None else telemetry.t_s)
        self._last_s = telemetry.t_s
        self._move_on(place)
        return self._command(place, min(max(elapsed_s, 0.0), LONGEST_TURN_S))

    def _begin(self, telemetry: Telemetry) -> None:
        """Set the gate frame: origin and heading of the vehicle, altitude of the goal."""
        self._start = telemetry.pose
        self._since_s = telemetry.t_s
        down_m = -self._altitude_m - telemetry.pose.position_ned_m[2]
        self._hold_m = (0.0, 0.0, down_m)
        self._track = GateTrack(0.0, down_m)

    def _in_flight_frame(self, vector_ned: Vec3) -> Vec3:
        """Return a NED vector in the gate frame: ahead, right, down."""
        course_rad = self._start.yaw_rad if self._start is not None else 0.0
        cos, sin = math.cos(course_rad), math.sin(course_rad)
        north, east, down = vector_ned
        return (north * cos + east * sin, east * cos - north * sin, down)

    def _move_on(self, place: _Place) -> None:
        """Enter the next phase of the gate flight when its condition holds."""
        track, along_m = self._track, place.at_m[0]
        seen = track.seen_within(place.t_s, self._set.lost_s)
        if self._phase == "search" and seen:
            self._phase = "approach"
        elif self._phase == "approach" and track.near(along_m):
            if self._miss_m(place) < self._set.commit_widths * track.width_m:
                self._phase = "through"
        elif self._phase == "approach" and not seen:
            self._search_again(place)
        elif self._phase == "through" and along_m >= self._stop_at_m() - ARRIVED_M:
            self._phase = "stop"
            self._hold_m = (self._stop_at_m(), track.right_m, track.down_m)

    def _search_again(self, place: _Place) -> None:
        self._phase, self._since_s = "search", place.t_s
        ahead_m, right_m, down_m = place.at_m
        speed_m_s = max(0.0, place.velocity_m_s[0])
        braking_m = speed_m_s * (REACTION_S + speed_m_s / (2.0 * self._set.acceleration_m_s2))
        self._hold_m = (ahead_m + braking_m, right_m, down_m)
        self._track = GateTrack(right_m, down_m)

    def _stop_at_m(self) -> float:
        return self._track.along_m + self._set.past_m

    def _miss_m(self, place: _Place) -> float:
        """Return the vehicle's distance from the line through the gate's centre, metres."""
        track = self._track
        return math.hypot(track.right_m - place.at_m[1], track.down_m - place.at_m[2])

    def _command(self, place: _Place, dt_s: float) -> Command:
        holds = self._phase in {"search", "stop"}
        track = self._track
        right_m, down_m = self._hold_m[1:] if holds else (track.right_m, track.down_m)
        wanted_m_s = self._hold_ahead(place) if holds else self._ahead(place)
        step_m_s = self._set.acceleration_m_s2 * dt_s
        change_m_s = max(-step_m_s, min(step_m_s, wanted_m_s - self._ahead_m_s))
        self._ahead_m_s += change_m_s
        right_m_s = self._side.step(right_m - place.at_m[1], place.velocity_m_s[1], dt_s)
        down_m_s = self._height.step(down_m - place.at_m[2], place.velocity_m_s[2], dt_s)
        speed_m_s = math.hypot(*place.velocity_m_s)
        left_m = abs(self._hold_m[0] - place.at_m[0])
        stands = speed_m_s < STANDING_M_S and left_m < 2.0 * ARRIVED_M
        self._done = self._done or (self._phase == "stop" and stands)
        setpoint = self._setpoint(self._ahead_m_s, right_m_s, down_m_s)
        return Command(setpoint, self._done, self._note(place))

    def _hold_ahead(self, place: _Place) -> float:
        limit_m_s = self._set.side_speed_m_s
        return max(-limit_m_s, min(limit_m_s, self._hold_m[0] - place.at_m[0]))

    def _ahead(self, place: _Place) -> float:
        """Return the forward speed to the gate: lower off its centre line, 0 before it is known."""
        track, along_m = self._track, place.at_m[0]
        fastest_m_s = min(self._set.speed_m_s, self._stoppable(self._stop_at_m() - along_m))
        if self._phase == "through":
            return fastest_m_s
        if track.only_side or track.near(along_m):
            return 0.0
        allowed_m = self._set.cone * (track.width_m + track.along_m - along_m)
        return fastest_m_s * max(0.0, min(1.0, 1.5 - self._miss_m(place) / allowed_m))

    def _stoppable(self, way_m: float) -> float:
        """Return the speed v that stops before the gate: way = v REACTION_S + v^2 / 2a."""
        a_m_s2 = self._set.acceleration_m_s2
        lost_m_s = a_m_s2 * REACTION_S
        return math.sqrt(lost_m_s * lost_m_s + 2.0 * a_m_s2 * max(0.0, way_m)) - lost_m_s

    def _setpoint(self, ahead: float, right: float, down: float) -> VelocitySetpoint:
        course_rad = self._start.yaw_rad if self._start is not None else 0.0
        cos, sin = math.cos(course_rad), math.sin(course_rad)
        velocity = (ahead * cos - right * sin, ahead * sin + right * cos, down)
        return VelocitySetpoint(velocity, yaw_rad=course_rad)

    def _note(self, place: _Place) -> str:
        if self._phase != "search":
            return self._phase
        gone_s = place.t_s - self._since_s
        return "gave up" if gone_s > self._set.search_timeout_s else "search"
