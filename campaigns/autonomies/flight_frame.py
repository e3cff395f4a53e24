"""The frame of a flight that keeps its heading, and velocity setpoints to positions in it."""

import math
from dataclasses import dataclass

from wil_campaign.api import Pose, Telemetry, Vec3, VelocitySetpoint, subtract

from .pid import PidController, PidGains

_LONGEST_STEP_S = 0.2
"""Longest time between two commands that counts for the integral; more is a gap."""


@dataclass(frozen=True, slots=True)
class FlightFrame:
    """The frame ahead, right and down of a start pose; later attitudes do not change it."""

    start: Pose

    def position(self, position_ned_m: Vec3) -> Vec3:
        """Return a position of the world in this frame, metres."""
        return self.vector(subtract(position_ned_m, self.start.position_ned_m))

    def vector(self, vector_ned: Vec3) -> Vec3:
        """Return a NED vector in this frame: ahead, right and down."""
        cos, sin = math.cos(self.start.yaw_rad), math.sin(self.start.yaw_rad)
        north, east, down = vector_ned
        return (north * cos + east * sin, east * cos - north * sin, down)

    def setpoint(self, velocity: Vec3) -> VelocitySetpoint:
        """Return the setpoint of a velocity ahead, right and down, with the start's heading."""
        yaw_rad = self.start.yaw_rad
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        ahead, right, down = velocity
        ned = (ahead * cos - right * sin, ahead * sin + right * cos, down)
        return VelocitySetpoint(ned, yaw_rad=yaw_rad)


class PositionController:
    """Flies a vehicle to a position in its flight frame, by a PID controller for each axis."""

    def __init__(self, gains: tuple[PidGains, PidGains, PidGains]) -> None:
        self._pids = tuple(PidController(gain) for gain in gains)
        self._last_s: float | None = None

    def velocity(self, wanted_m: Vec3, telemetry: Telemetry, frame: FlightFrame) -> Vec3:
        """Return the velocity ahead, right and down to a position in the frame."""
        last_s, self._last_s = self._last_s, telemetry.t_s
        dt_s = 0.0 if last_s is None else min(max(telemetry.t_s - last_s, 0.0), _LONGEST_STEP_S)
        here_m = frame.position(telemetry.pose.position_ned_m)
        speeds = frame.vector(telemetry.velocity_ned_m_s)
        ahead, right, down = (
            pid.step(wanted - here, speed, dt_s)
            for pid, wanted, here, speed in zip(self._pids, wanted_m, here_m, speeds, strict=True)
        )
        return (ahead, right, down)
