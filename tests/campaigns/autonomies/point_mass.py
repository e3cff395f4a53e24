"""A point mass that follows velocities with a lag, and a detector that sees boxes of geometry."""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from wil_campaign.plugins.detector.detector import Detection
from wil_campaign.vehicles.autonomy import Autonomy, Command, Telemetry
from wil_campaign.vehicles.readings import CameraReading
from wil_campaign.vehicles.setpoints import VelocitySetpoint
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose, Vec3

CAMERA = Intrinsics.from_fov(640, 480, math.radians(69.0))
IMAGE_S, TURN_S, LAG_S, LATENCY_S = 1.0 / 15.0, 0.05, 0.35, 0.08
BLANK = np.zeros((480, 640, 3), np.uint8)

Corners = Callable[[float], list[Vec3]]
"""Where an object's extreme points are at a time, NED metres."""


@dataclass
class GeometryFinder:
    """In place of a detector: the box round projected corners, with noise, or nothing."""

    corners: Corners
    noise_px: float = 0.0
    hidden: tuple[float, float] = (math.inf, math.inf)
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(1))
    pose: Pose = field(default_factory=lambda: Pose((0.0, 0.0, 0.0)))

    def find(self, reading: CameraReading) -> Detection | None:
        if self.hidden[0] <= reading.t_s < self.hidden[1]:
            return None
        shown = [CAMERA.project(self.pose.to_local(corner)) for corner in self.corners(reading.t_s)]
        found = [one for one in shown if one is not None]
        if not found:
            return None
        u, v = zip(*found, strict=True)
        if max(u) < 0 or min(u) > 640 or max(v) < 0 or min(v) > 480:
            return None
        edges = (
            np.array([min(u), min(v), max(u), max(v)]) + self.rng.normal(0, 1, 4) * self.noise_px
        )
        left, top, right, bottom = (float(one) for one in np.clip(edges, 0, [640, 480, 640, 480]))
        return Detection("thing", 0.9, left, top, right, bottom)


@dataclass
class Flight:
    """The path and the commands of a flight."""

    path: list[tuple[float, Vec3]] = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)

    def notes(self) -> list[str]:
        return [command.note for command in self.commands]


def fly(autonomy: Autonomy, finder: GeometryFinder, for_s: float) -> Flight:
    """Fly an autonomy from the origin at 1.2 m, heading north; images come late."""
    flight = Flight()
    position, velocity = np.array([0.0, 0.0, -1.2]), np.zeros(3)
    waiting: deque[CameraReading] = deque()
    poses: dict[float, Pose] = {}
    for turn in range(int(for_s / TURN_S)):
        t_s = turn * TURN_S
        pose = Pose((float(position[0]), float(position[1]), float(position[2])))
        flight.path.append((t_s, pose.position_ned_m))
        if t_s // IMAGE_S > (t_s - TURN_S) // IMAGE_S:
            waiting.append(CameraReading(t_s, t_s + LATENCY_S, 0, "mixed", BLANK, CAMERA))
            poses[t_s] = pose
        while waiting and waiting[0].arrived_s <= t_s:
            reading = waiting.popleft()
            finder.pose = poses[reading.t_s]
            autonomy.perceive(reading)
        speed = (float(velocity[0]), float(velocity[1]), float(velocity[2]))
        command = autonomy.act(Telemetry(t_s, pose, speed))
        flight.commands.append(command)
        if command.done:
            break
        assert isinstance(command.setpoint, VelocitySetpoint)
        wanted = np.array(command.setpoint.velocity_ned_m_s)
        velocity = velocity + (wanted - velocity) / LAG_S * TURN_S
        position = position + velocity * TURN_S
    return flight
