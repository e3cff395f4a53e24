"""The emulated motion capture: the true pose with white noise, sampled at its rate and delayed."""

import math
import sys
from collections import deque
from collections.abc import Callable

import numpy as np

from wil_campaign.foundation.tasks import SuppressedErrors
from wil_campaign.vehicles.embedded.profile import MotionCapture
from wil_campaign.vehicles.poses.truth import TruthSample
from wil_campaign.vehicles.readings import PoseReading, Source
from wil_campaign.worlds.frames import Pose, quat_from_euler, quat_multiply

_LISTENER = SuppressedErrors("a listener to motion capture")
NEVER = sys.maxsize
_BLOCK = 128
"""Number of samples whose noise is drawn at once: drawing single samples is slow."""


class MotionCaptureFeed:
    """The emulated motion capture: from truth to readings; their `t_s` is the time of the pose."""

    def __init__(
        self, *, noise: MotionCapture, source: Source, physics_hz: int, rng: np.random.Generator
    ) -> None:
        self._noise = noise
        self._source = source
        self._physics_hz = physics_hz
        self._rng = rng
        self._normals: list[list[float]] = []
        self._in_transit: deque[tuple[float, TruthSample, Pose]] = deque()
        self._callbacks: list[Callable[[PoseReading], None]] = []
        self.next_step = NEVER
        """The next physics step that motion capture samples; NEVER without receivers."""
        across, down = noise.position_sigma_m
        angle_rad = math.radians(noise.attitude_sigma_deg)
        self._sigma = (across, across, down, angle_rad, angle_rad, angle_rad)
        self._noisy = any(self._sigma)

    def add(self, callback: Callable[[PoseReading], None], *, step: int = 0) -> None:
        """Add a receiver of the motion capture feed at a physics step."""
        self._callbacks.append(callback)
        self._seek(step)

    def _seek(self, step: int) -> None:
        """Set the next step to the first one after `step` that motion capture samples."""
        # Integers: the k-th sample is taken at the first step not before k / rate.
        rate_hz, physics_hz = self._noise.rate_hz, self._physics_hz
        number = step * rate_hz // physics_hz + 1
        self.next_step = -(-number * physics_hz // rate_hz)

    def receive(self, truth: TruthSample) -> None:
        """Sample the vehicle's true pose, of the next step, for motion capture."""
        self._seek(self.next_step)
        pose = truth.pose
        if self._noisy:
            if not self._normals:
                self._normals = (self._rng.standard_normal((_BLOCK, 6)) * self._sigma).tolist()
            x, y, z, roll, pitch, yaw = self._normals.pop()
            north, east, down = pose.position_ned_m
            pose = Pose(
                (north + x, east + y, down + z),
                quat_multiply(pose.q_wxyz, quat_from_euler(roll, pitch, yaw)),
            )
        self._in_transit.append((truth.t_s + self._noise.latency_s, truth, pose))

    @property
    def next_due_s(self) -> float | None:
        """Return when the next motion capture reading arrives; None when there is none."""
        return self._in_transit[0][0] if self._in_transit else None

    def deliver(self, now_s: float) -> None:
        """Deliver the motion capture readings that have arrived by now."""
        while self._in_transit and self._in_transit[0][0] <= now_s + 1e-9:
            _, truth, pose = self._in_transit.popleft()
            reading = PoseReading(truth.t_s, now_s, self._source, pose, truth.velocity_ned_m_s)
            for callback in self._callbacks:
                with _LISTENER:
                    callback(reading)
