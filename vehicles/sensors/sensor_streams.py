"""Streams of sensor readings: at the sensor's rate, or on demand from a given pose."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np

from wil_campaign.foundation.clocks.sleeping import sleep_until
from wil_campaign.vehicles.cameras.rendered_cameras import (
    CameraCompute,
    ImageSource,
    compute_inline,
    deliver_due_readings,
    next_camera_tick,
)
from wil_campaign.vehicles.readings import CameraReading, DepthReading, PoseReading, Reading, Source
from wil_campaign.vehicles.sensors.depth import DepthSensor
from wil_campaign.vehicles.sensors.sensor_spec import Sensor
from wil_campaign.vehicles.sensors.timing import Timing
from wil_campaign.vehicles.sensors.truth import Truth
from wil_campaign.vehicles.sensors.truth_history import TruthHistory
from wil_campaign.worlds.camera import CameraMount, Intrinsics
from wil_campaign.worlds.frames import Pose

Deliver = Callable[[Reading], None]

TRUTH_DELAY_S = 0.01
"""How long after a tick its truth is looked up: by then the samples around it have arrived."""


class ReadingStream(Protocol):
    """A vehicle's sensor that streams readings by itself (protocol)."""

    async def run(self, deliver: Deliver) -> None:
        """Stream readings until cancelled; what `deliver` raises ends it."""


class SensesOnDemand(Protocol):
    """A sensor of the twin that senses at a requested pose (protocol)."""

    async def ask(
        self, body: Pose, t_s: float, *, want_depth: bool = False, want_ids: bool = False
    ) -> Reading:
        """Return the sensor's reading from a body's pose (world frame) at t_s."""


class SensorStream:
    """A stream of a sensor that samples the vehicle's truth at start + k / rate_hz.

    A reading is delivered at its arrival time, in order, and never before it was made; one whose
    truth is not known is left out, and its number with it. truth_delay_s: how long after a tick its
    truth is looked up, for truth that arrives late.
    """

    def __init__(
        self,
        *,
        sensor: Sensor,
        track: TruthHistory,
        rate_hz: float,
        rng: np.random.Generator,
        compute: CameraCompute = compute_inline,
        truth_delay_s: float = TRUTH_DELAY_S,
    ) -> None:
        self._truth_delay_s = truth_delay_s
        self._sensor = sensor
        self._track = track
        self._rate_hz = rate_hz
        self._rng = rng
        self._compute = compute
        self.left_out = 0

    async def run(self, deliver: Deliver) -> None:
        """Sample and stream readings until cancelled; what `deliver` raises ends it."""
        ready: asyncio.Queue[Reading] = asyncio.Queue()
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._sense(ready), name="sensor samples")
            tasks.create_task(deliver_due_readings(ready, deliver), name="sensor delivery")

    async def _sense(self, ready: asyncio.Queue[Reading]) -> None:
        loop = asyncio.get_running_loop()
        start_s, tick = loop.time(), 0
        while True:
            t_s = start_s + tick / self._rate_hz
            await sleep_until(t_s + self._truth_delay_s)
            truth = self._track.at(t_s)
            if truth is None:
                self.left_out += 1
            else:
                ready.put_nowait(replace(await self._sample(truth, t_s), seq=tick))
            behind_s = loop.time() - self._truth_delay_s - start_s
            following = max(tick + 1, next_camera_tick(behind_s, self._rate_hz))
            self.left_out += following - tick - 1
            tick = following

    async def _sample(self, truth: Truth, t_s: float) -> Reading:
        return await self._compute(lambda: self._sensor.sample(truth, t_s, self._rng))


class PoseStream:
    """A stream of motion capture as a sensor: at most at its rate, numbered."""

    def __init__(
        self, *, listen: Callable[[Callable[[PoseReading], None]], None], rate_hz: float | None
    ) -> None:
        self._listen = listen
        self._period_s = 0.0 if rate_hz is None else 1.0 / rate_hz
        self._due_s = 0.0
        self._seq = 0

    async def run(self, deliver: Deliver) -> None:
        """Stream poses until cancelled; what `deliver` raises ends it."""
        captured: asyncio.Queue[PoseReading] = asyncio.Queue()
        self._listen(captured.put_nowait)
        while True:
            reading = await captured.get()
            if reading.t_s < self._due_s - 1e-6:
                continue
            self._due_s = max(self._due_s + self._period_s, reading.t_s)
            self._seq += 1
            deliver(replace(reading, seq=self._seq - 1))


class RenderedDepth:
    """A depth camera sensor with rendered depth. timing: when its images are delivered."""

    def __init__(
        self,
        *,
        source: ImageSource,
        intrinsics: Intrinsics,
        mount: CameraMount,
        side: Source,
        sensor: DepthSensor,
        timing: Timing,
    ) -> None:
        self._source = source
        self._intrinsics = intrinsics
        self._mount = mount
        self._side: Source = side
        self._sensor = sensor
        self._timing = timing

    def sample(self, truth: Truth, t_s: float, rng: np.random.Generator) -> DepthReading:
        """Return the depth image of t_s."""
        camera_pose = self._mount.camera_pose(truth.pose)
        picture = self._source.picture(
            camera_pose, self._intrinsics, t_s, want_depth=True, want_ids=True
        )
        seen = CameraReading(
            t_s=t_s,
            arrived_s=self._timing.arrival_s(t_s, rng),
            seq=0,
            source=self._side,
            image_bgr=picture.image_bgr,
            intrinsics=self._intrinsics,
            depth_m=picture.depth_m,
            object_ids=picture.object_ids,
            camera_pose=camera_pose,
        )
        mount = self._mount.in_body(truth.pose)
        return replace(self._sensor.sample(seen, rng), mount=mount)


class OnDemandSensor:
    """A sensor of the twin that senses at once, from any pose, without motion."""

    def __init__(
        self, *, sensor: Sensor, rng: np.random.Generator, compute: CameraCompute = compute_inline
    ) -> None:
        self._sensor = sensor
        self._rng = rng
        self._compute = compute
        self._seq = 0

    async def ask(
        self,
        body: Pose,
        t_s: float,
        *,
        want_depth: bool = False,  # noqa: ARG002 - only cameras use it
        want_ids: bool = False,  # noqa: ARG002 - the same
    ) -> Reading:
        """Return the sensor's reading from a body's pose (world frame) at t_s."""
        seq, self._seq = self._seq, self._seq + 1
        reading = await self._compute(lambda: self._sensor.sample(Truth(body), t_s, self._rng))
        return replace(reading, arrived_s=asyncio.get_running_loop().time(), seq=seq)
