"""Mixing while flying: each real picture is met by the twin's of the same moment and pose."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass

from orchestrator.run.statistics import MixingStatistics
from recipes.alignment import align_pose
from recipes.mixed import Mixed
from recipes.pipeline import Mixer
from vehicles.cameras import AskedCamera, sleep_until
from vehicles.pose_history import PoseHistory
from vehicles.readings import CameraReading

_POSE_POLL_S = 0.002

Deliver = Callable[[CameraReading], None]
Registration = Callable[[CameraReading], float | None]


@dataclass(frozen=True, slots=True)
class Frames:
    """The pictures behind one mixed reading, for whoever wants to look at them."""

    real: CameraReading
    twin: CameraReading | None
    mixed: CameraReading


class MixingLoop:
    """Mixes one camera's readings and delivers them to whoever perceives.

    poses: of the vehicle from whose place the twin's picture is asked (recipe's `register`).
    wait_s: how long a pose for the exposure is waited for. registration: gives the error in
    pixels of a twin's picture against an independent reference; None without one. deliver: takes
    each mixed reading. watch: takes the frames behind it. trouble: told when a twin's picture
    could not be used, or a real one could not be mixed.
    A picture that comes while one is being mixed waits; a third replaces the one that waits and
    counts as dropped: what is late is not worth having.
    """

    def __init__(
        self,
        *,
        mixer: Mixer,
        twin: AskedCamera | None,
        poses: PoseHistory,
        wait_s: float,
        registration: Registration | None,
        deliver: Deliver,
        watch: Callable[[Frames], None],
        trouble: Callable[[Mixed], None],
    ) -> None:
        self._mixer = mixer
        self._twin = twin
        self._poses = poses
        self._wait_s = wait_s
        self._registration = registration
        self._deliver = deliver
        self._watch = watch
        self._trouble = trouble
        self._waiting: CameraReading | None = None
        self._twin_picture: CameraReading | None = None
        self._arrived = asyncio.Event()
        self.statistics = MixingStatistics()

    def real_picture(self, reading: CameraReading) -> None:
        """Take a picture of the real vehicle's camera."""
        if self._waiting is not None:
            self.statistics.dropped += 1
        self._waiting = reading
        self._arrived.set()

    def twin_picture(self, reading: CameraReading) -> None:
        """Take a picture of the twin's own camera: for recipes that do not ask for a pose."""
        self._twin_picture = reading

    async def run(self) -> None:
        """Mix until cancelled."""
        while True:
            await self._arrived.wait()
            self._arrived.clear()
            reading, self._waiting = self._waiting, None
            if reading is not None:
                await self._mix(reading)

    async def _mix(self, real: CameraReading) -> None:
        twin, alignment = await self._twin_for(real)
        now_s = asyncio.get_running_loop().time()
        mixed = self._mixer.mix(real, twin, now_s=now_s, alignment=alignment)
        self._account(mixed, twin)
        if mixed.reading is not None:
            self.statistics.delivered(now_s)
            self._watch(Frames(real, twin, mixed.reading))
            self._deliver(mixed.reading)

    async def _twin_for(self, real: CameraReading) -> tuple[CameraReading | None, str]:
        """Return the twin's picture to be mixed with the real one, and how it was aligned."""
        request = self._mixer.pose_request
        if request is None or self._twin is None:
            return self._twin_picture, "as it came"
        if request.align == "interpolate":
            await self._pose_has_come(real.t_s)
        found = align_pose(
            request, self._poses, exposure_s=real.t_s, now_s=asyncio.get_running_loop().time()
        )
        if found is None:
            return None, "no pose"
        picture = await self._twin.ask(
            found.pose,
            found.t_s,
            want_ids="ids" in self._mixer.needs,
            want_depth="depth" in self._mixer.needs,
        )
        return picture, found.how

    async def _pose_has_come(self, t_s: float) -> None:
        """Wait until the pose source has passed t_s, for a short while."""
        loop = asyncio.get_running_loop()
        give_up_s = loop.time() + self._wait_s
        while self._poses.at(t_s).kind != "interpolated" and loop.time() < give_up_s:
            await sleep_until(loop.time() + _POSE_POLL_S)

    def _account(self, mixed: Mixed, twin: CameraReading | None) -> None:
        provenance = mixed.provenance
        if provenance.dropped is not None:
            self.statistics.dropped += 1
            self._trouble(mixed)
        if provenance.skew_ms is not None:
            self.statistics.skew_ms.add(provenance.skew_ms)
        if provenance.latency_ms is not None:
            self.statistics.latency_ms.add(provenance.latency_ms)
        if self._registration is not None and twin is not None:
            error_px = self._registration(twin)
            if error_px is not None:
                self.statistics.registration_error_px.add(error_px)
