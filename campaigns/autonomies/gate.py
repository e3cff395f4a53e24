"""Fly through a gate that the camera sees: the autonomy of the paper's first scenario.

"The subsystem works by identifying the gate and navigates the quadrotor towards the center of the
gate's mass using a PID controller" (section IV), through it, and stops. It knows the colour of the
gate, not its size or place. The vehicle keeps the heading of its start, and moves sideways and up
or down onto the line through the gate's centre while it flies ahead.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from wil_campaign.api import (
    NAMED_COLORS,
    BlobFinder,
    CameraReading,
    Command,
    PoseHistory,
    Reading,
    Telemetry,
    Vec3,
    quat_from_euler,
)

from .braking import stopping_speed
from .flight_frame import FlightFrame
from .gate_parameters import OWNER, parse_gate_parameters
from .gate_sight import GateCameraView, gate_sight_of
from .gate_track import GateTrack
from .parameters import goal_altitude_m
from .pid import PidController, PidGains

Phase = Literal["search", "approach", "through", "stop"]

LONGEST_STEP_S = 0.2
"""Longest time between two commands that counts for integral and acceleration; more is a gap."""

REACTION_S = 0.4
"""Delay from a command until the vehicle has its speed: a multicopter tilts before it brakes."""

ARRIVED_M = 0.05
STANDING_M_S = 0.2


@dataclass(frozen=True, slots=True)
class _State:
    """The vehicle's position (m) and velocity (m/s) in the flight frame: ahead, right, down."""

    t_s: float
    position_m: Vec3
    velocity_m_s: Vec3


class GateAutonomy:
    """The shipped gate autonomy: finds the gate, flies through its middle, stops behind it."""

    def __init__(
        self, *, goal: Mapping[str, float | str], parameters: Mapping[str, object], seed: int
    ) -> None:
        """Raise ValueError on unknown gate parameters, or ones of the wrong type.

        parameters: those of GateParameters. goal: altitude_m above the world's ground, at which to
        search; its other keys are for the oracles. seed: unused.
        """
        del seed
        self._parameters = parse_gate_parameters(parameters)
        self._altitude_m = goal_altitude_m(goal, OWNER)
        self._finder = BlobFinder(NAMED_COLORS[self._parameters.color])
        self._history = PoseHistory(2.0, max_gap_s=0.6, max_prediction_s=0.1)
        gains = PidGains(
            self._parameters.kp,
            self._parameters.ki,
            self._parameters.kd,
            self._parameters.side_speed_m_s,
        )
        self._side, self._height = PidController(gains), PidController(gains)
        self._phase: Phase = "search"
        self._frame: FlightFrame | None = None
        self._search_began_s = 0.0
        self._hold_m: Vec3 = (0.0, 0.0, 0.0)
        self._track = GateTrack(0.0, 0.0)
        self._ahead_m_s = 0.0
        self._done = False
        self._last_s: float | None = None

    def perceive(self, reading: Reading) -> None:
        """Look for the gate in an image; other readings, and early images, are ignored."""
        if not isinstance(reading, CameraReading) or self._frame is None or self._phase == "stop":
            return
        pose = self._history.at(reading.t_s).pose
        blob = self._finder.find(reading.image_bgr) if pose is not None else None
        if pose is None or blob is None:
            return
        q_wxyz = pose.q_wxyz
        if self._parameters.camera_stabilized:
            q_wxyz = quat_from_euler(0.0, 0.0, pose.yaw_rad)
        view = GateCameraView(reading.intrinsics, q_wxyz, self._frame.start.yaw_rad)
        position_m = self._frame.position(pose.position_ned_m)
        self._track.update(gate_sight_of(blob, view), position_m, reading.t_s)

    def act(self, telemetry: Telemetry) -> Command:
        """Return the velocity setpoint towards, or through, the gate."""
        self._history.add(telemetry.t_s, telemetry.pose, telemetry.velocity_ned_m_s)
        frame = self._begin(telemetry) if self._frame is None else self._frame
        state = _State(
            telemetry.t_s,
            frame.position(telemetry.pose.position_ned_m),
            frame.vector(telemetry.velocity_ned_m_s),
        )
        elapsed_s = telemetry.t_s - (self._last_s if self._last_s is not None else telemetry.t_s)
        self._last_s = telemetry.t_s
        self._update_phase(state)
        return self._command(frame, state, min(max(elapsed_s, 0.0), LONGEST_STEP_S))

    def _begin(self, telemetry: Telemetry) -> FlightFrame:
        """Begin the search at the goal's altitude; return the frame of the flight."""
        self._frame = FlightFrame(telemetry.pose)
        self._search_began_s = telemetry.t_s
        down_m = -self._altitude_m - telemetry.pose.position_ned_m[2]
        self._hold_m = (0.0, 0.0, down_m)
        self._track = GateTrack(0.0, down_m)
        return self._frame

    def _update_phase(self, state: _State) -> None:
        """Enter the next phase of the gate flight when its condition holds."""
        track, along_m = self._track, state.position_m[0]
        is_seen = track.seen_within(state.t_s, self._parameters.lost_s)
        if self._phase == "search" and is_seen:
            self._phase = "approach"
        elif self._phase == "approach" and track.near(along_m):
            if self._off_centre_m(state) < self._parameters.commit_widths * track.width_m:
                self._phase = "through"
        elif self._phase == "approach" and not is_seen:
            self._search_again(state)
        elif self._phase == "through" and along_m >= self._stop_at_m() - ARRIVED_M:
            self._phase = "stop"
            self._hold_m = (self._stop_at_m(), track.right_m, track.down_m)

    def _search_again(self, state: _State) -> None:
        """Brake to a stop, and forget the gate that is no longer seen."""
        self._phase, self._search_began_s = "search", state.t_s
        ahead_m, right_m, down_m = state.position_m
        speed_m_s = max(0.0, state.velocity_m_s[0])
        braking_s = REACTION_S + speed_m_s / (2.0 * self._parameters.acceleration_m_s2)
        self._hold_m = (ahead_m + speed_m_s * braking_s, right_m, down_m)
        self._track = GateTrack(right_m, down_m)

    def _stop_at_m(self) -> float:
        return self._track.along_m + self._parameters.past_m

    def _off_centre_m(self, state: _State) -> float:
        """Return the vehicle's distance from the line through the gate's centre, metres."""
        track = self._track
        return math.hypot(track.right_m - state.position_m[1], track.down_m - state.position_m[2])

    def _command(self, frame: FlightFrame, state: _State, dt_s: float) -> Command:
        is_holding = self._phase in {"search", "stop"}
        track = self._track
        right_m, down_m = self._hold_m[1:] if is_holding else (track.right_m, track.down_m)
        wanted_m_s = self._holding_speed(state) if is_holding else self._forward_speed(state)
        step_m_s = self._parameters.acceleration_m_s2 * dt_s
        self._ahead_m_s += max(-step_m_s, min(step_m_s, wanted_m_s - self._ahead_m_s))
        right_m_s = self._side.step(right_m - state.position_m[1], state.velocity_m_s[1], dt_s)
        down_m_s = self._height.step(down_m - state.position_m[2], state.velocity_m_s[2], dt_s)
        is_standing = math.hypot(*state.velocity_m_s) < STANDING_M_S
        is_arrived = abs(self._hold_m[0] - state.position_m[0]) < 2.0 * ARRIVED_M
        self._done = self._done or (self._phase == "stop" and is_standing and is_arrived)
        setpoint = frame.setpoint((self._ahead_m_s, right_m_s, down_m_s))
        return Command(setpoint, self._done, self._note(state))

    def _holding_speed(self, state: _State) -> float:
        """Return the speed ahead that holds the place, m/s."""
        limit_m_s = self._parameters.side_speed_m_s
        return max(-limit_m_s, min(limit_m_s, self._hold_m[0] - state.position_m[0]))

    def _forward_speed(self, state: _State) -> float:
        """Return the speed ahead to the gate: lower off its centre line, 0 before it is known."""
        track, along_m = self._track, state.position_m[0]
        stopping_m_s = stopping_speed(
            self._stop_at_m() - along_m,
            acceleration_m_s2=self._parameters.acceleration_m_s2,
            reaction_s=REACTION_S,
        )
        fastest_m_s = min(self._parameters.speed_m_s, stopping_m_s)
        if self._phase == "through":
            return fastest_m_s
        if track.only_side or track.near(along_m):
            return 0.0
        allowed_m = self._parameters.cone * (track.width_m + track.along_m - along_m)
        return fastest_m_s * max(0.0, min(1.0, 1.5 - self._off_centre_m(state) / allowed_m))

    def _note(self, state: _State) -> str:
        if self._phase != "search":
            return self._phase
        searched_s = state.t_s - self._search_began_s
        return "gave up" if searched_s > self._parameters.search_timeout_s else "search"
