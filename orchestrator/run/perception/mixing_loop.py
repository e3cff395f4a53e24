"""Mixing in flight: each real reading is mixed with the twin's of the same time and pose."""

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

from wil_campaign.foundation.clocks.sleeping import sleep_until
from wil_campaign.orchestrator.run.perception.mixing_statistics import MixingStatistics
from wil_campaign.orchestrator.run.perception.visibility import VisibilityProbe
from wil_campaign.orchestrator.state.mixtures import MixedFrame
from wil_campaign.recipes.pipeline.mixture import MixedReading
from wil_campaign.recipes.pipeline.pipeline import Mixer
from wil_campaign.recipes.pipeline.pose_alignment import align_pose
from wil_campaign.vehicles.cameras.rendered_cameras import NoImageError
from wil_campaign.vehicles.poses.pose_history import PoseHistory
from wil_campaign.vehicles.readings import Reading, reading_end_s
from wil_campaign.vehicles.readings.kinds import reading_duration_s, traits_of
from wil_campaign.vehicles.sensors.sensor_streams import SensesOnDemand
from wil_campaign.worlds.figures import distinct_value_text

_POSE_POLL_S = 0.002
_PAIR_WAIT_S = 0.05
"""How long a real reading waits for the twin's of its time, where the twin streams readings."""
_WAITING_BIG = 1
_WAITING_SMALL = 32
"""Most readings that wait to be mixed: a late image is useless, while small readings come in bursts
when the loop was busy."""
_MOST_KEPT_BIG = 8
_MOST_KEPT_SMALL = 64
"""Most readings that are kept: of the twin, to find that of a time; of the real sensor, undue."""
_MOST_AWAITED_BIG = 32
"""The same of the twin's images that real ones, which come later, may still need."""
_EARLY_S = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class _Waiting:
    """A real reading in its order of arrival. is_due: it is mixed; others are only offered."""

    reading: Reading
    is_due: bool


@dataclass(frozen=True, slots=True)
class RegistrationError:
    """A mixture's registration error, RMS in pixels; None: nothing virtual in view.

    error_px: against an independent reference; None without one. bound_px: without a reference,
    the bound of the error by the accuracy of the pose. unbounded: why there is no bound.
    """

    error_px: float | None = None
    bound_px: float | None = None
    unbounded: str = ""


Registration = Callable[[Reading, float], RegistrationError]
"""Returns the error for the twin's reading and the exposure time of the real image below it."""


class MixingLoop:
    """Mixes the readings of one sensor in a loop and reports each mixture.

    name: of the combination. twin: the on-demand source of the twin's readings at the pose of the
    recipe's `register`; None where the twin streams them (`twin_reading`). poses: of the vehicle
    whose pose is requested. wait_s: longest wait for the pose of an exposure. period_s: of the real
    readings, and the longest wait for the twin's. rate_hz: mean rate of mixtures, each of the
    reading nearest to its due time; None mixes every real reading. registration: measures the
    registration error; None for sensors without pixels. probe: measures the visibility of virtual
    objects; None where it cannot be measured, for the reason `unmeasured`. on_mixture: called with
    each mixture, also one that was dropped. on_fault: called with the fault of a refused reading.

    A real reading that comes when too many wait replaces the oldest, which counts as replaced. One
    for which the twin's source returns no image within the recipe's max_latency_ms counts as
    missed: a camera, too, loses a frame now and then. Both are still offered to the mixer in their
    turn, as steps that select by time see all real readings. After `run` has ended readings are
    ignored: a live camera goes on. Raises StepError when a step fails.
    """

    def __init__(
        self,
        *,
        name: str,
        mixer: Mixer,
        twin: SensesOnDemand | None,
        poses: PoseHistory,
        wait_s: float,
        period_s: float,
        rate_hz: float | None,
        registration: Registration | None,
        probe: VisibilityProbe | None = None,
        unmeasured: str = "",
        on_mixture: Callable[[MixedFrame], None],
        on_fault: Callable[[str], None],
    ) -> None:
        self.name = name
        self.mixer = mixer
        self.statistics = MixingStatistics()
        self._twin = twin
        self._poses = poses
        self._wait_s = wait_s
        self._pair_wait_s = min(_PAIR_WAIT_S, period_s)
        self._period_s = 0.0 if rate_hz is None else 1.0 / rate_hz
        self._early_s = max(_EARLY_S, min(period_s, self._period_s) / 2.0 - _EARLY_S)
        self._due_s = 0.0
        self._requested_s = self._mixed_s = 0.0
        self._registration = registration
        self.probe = probe
        self.unmeasured = unmeasured
        self._on_mixture = on_mixture
        self._on_fault = on_fault
        self._waiting: deque[_Waiting] = deque()
        self._is_mixing = self._is_over = False
        self._twin_readings: deque[Reading] = deque(maxlen=_MOST_KEPT_SMALL)
        self._arrived = asyncio.Event()

    def real_reading(self, reading: Reading) -> None:
        """Take the real sensor's reading into the mixing loop."""
        if self._is_over:
            return
        is_due = self._is_due(reading)
        if not (is_due or self._is_mixing or self._waiting):
            self.mixer.offer("real", reading)
            return
        # Queued behind those that wait: a step that selects by time sees all in their order.
        self._make_way(is_due=is_due, is_big=_is_big(reading))
        self._waiting.append(_Waiting(reading, is_due))
        self._arrived.set()

    def _make_way(self, *, is_due: bool, is_big: bool) -> None:
        """Let the oldest waiting reading of the same kind go if the queue is full.

        One that was due is still offered in its turn; one that was not is dropped.
        """
        if is_due:
            most = _WAITING_BIG if is_big else _WAITING_SMALL
        else:
            most = _MOST_KEPT_BIG if is_big else _MOST_KEPT_SMALL
        alike = [waiting for waiting in self._waiting if waiting.is_due is is_due]
        if len(alike) < most:
            return
        if is_due:
            self._make_way(is_due=False, is_big=is_big)
            self._waiting[self._waiting.index(alike[0])] = replace(alike[0], is_due=False)
            self.statistics.replaced += 1
        else:
            self._waiting.remove(alike[0])

    def _is_due(self, reading: Reading) -> bool:
        """Return whether a reading is due for mixing: on average at the recipe's rate.

        A reading nearer to the due time than the next one would be is due, so that a camera at
        the recipe's rate loses no frame by the jitter of its stamps.
        """
        if self._period_s == 0.0:
            return True
        if reading.t_s < self._due_s - self._early_s:
            return False
        behind = reading.t_s - self._due_s >= self._period_s
        self._due_s = (reading.t_s if behind else self._due_s) + self._period_s
        return True

    def twin_reading(self, reading: Reading) -> None:
        """Take the twin sensor's reading: for recipes without `register`."""
        if self._is_over:
            return
        fault = self.mixer.offer("twin", reading)
        if fault is not None:
            self._on_fault(fault)
            return
        kept = self._twin_readings
        while _is_big(reading) and len(kept) >= _MOST_KEPT_BIG:
            if len(kept) < _MOST_AWAITED_BIG and kept[1].t_s > self._mixed_s:
                break
            kept.popleft()
        kept.append(reading)
        self._arrived.set()

    async def run(self) -> None:
        """Mix readings until cancelled."""
        try:
            while True:
                await self._arrived.wait()
                self._arrived.clear()
                self._is_mixing = True
                while self._offer_readings_before_due():
                    await self._mix()
                self._is_mixing = False
        finally:
            self._is_over = True
            self._waiting.clear()
            self._twin_readings.clear()

    def _offer_readings_before_due(self) -> bool:
        """Offer the readings before the next due one; return whether a due one waits."""
        while self._waiting and not self._waiting[0].is_due:
            self.mixer.offer("real", self._waiting.popleft().reading)
        return bool(self._waiting)

    def _next_due(self) -> Reading:
        self._offer_readings_before_due()
        return self._waiting.popleft().reading

    async def _mix(self) -> None:
        if self._twin is None:
            await self._await_twin()
            real = self._next_due()
            self._mixed_s = real.t_s
            twin, alignment = self._nearest(real.t_s), "as it came"
        else:
            real = self._next_due()
            try:
                twin, alignment = await self._request_twin(self._twin, real)
            except NoImageError as error:
                self.statistics.miss(str(error))
                self.mixer.offer("real", real)
                return
        now_s = asyncio.get_running_loop().time()
        if self.probe is not None:
            self.probe.begin()
        mixed: MixedReading[Reading] = self.mixer.mix(real, twin, now_s=now_s, alignment=alignment)
        visibility = None if self.probe is None else self.probe.measure(mixed)
        unbounded = ""
        if self._registration is not None and twin is not None:
            provenance = mixed.provenance
            # A step may have selected an older image of the real camera.
            exposed_s = real.t_s if provenance.real_t_s is None else provenance.real_t_s
            registration = self._registration(twin, exposed_s)
            provenance = replace(
                provenance,
                registration_error_px=registration.error_px,
                registration_bound_px=registration.bound_px,
            )
            mixed = MixedReading(mixed.reading, provenance)
            unbounded = registration.unbounded
            self.statistics.unbounded = unbounded or self.statistics.unbounded
        delivered_s = asyncio.get_running_loop().time()
        if delivered_s > now_s:
            mixed = _delivered(mixed, delivered_s, mixing_s=delivered_s - now_s)
        self._account(mixed, delivered_s)
        frame = MixedFrame(self.name, self.mixer.sensor, real, twin, mixed, visibility, unbounded)
        self._on_mixture(frame)

    async def _await_twin(self) -> None:
        """Wait for the twin's reading of the oldest real one that is due.

        Meanwhile a newer real reading may replace that one.
        """
        if self._has_twin_come():
            return
        try:
            async with asyncio.timeout_at(self._give_up_s()):
                while not self._has_twin_come():
                    self._arrived.clear()
                    await self._arrived.wait()
        except TimeoutError:
            return

    def _give_up_s(self) -> float:
        """Return the time until which the oldest due reading waits for the twin's.

        One that lasts waits as long as the twin's that ends after it takes to come.
        """
        give_up_s = asyncio.get_running_loop().time() + self._pair_wait_s
        newest = self._twin_readings[-1] if self._twin_readings else None
        if newest is not None and (lasts_s := reading_duration_s(newest)) > 0.0:
            comes_s = self._oldest_due_end_s() + lasts_s
            give_up_s = max(give_up_s, comes_s + _PAIR_WAIT_S)
        return give_up_s

    def _has_twin_come(self) -> bool:
        if not self._twin_readings:
            return False
        return reading_end_s(self._twin_readings[-1]) >= self._oldest_due_end_s() - _EARLY_S

    def _oldest_due_end_s(self) -> float:
        return next(reading_end_s(waiting.reading) for waiting in self._waiting if waiting.is_due)

    def _nearest(self, t_s: float) -> Reading | None:
        return min(self._twin_readings, key=lambda reading: abs(reading.t_s - t_s), default=None)

    async def _request_twin(self, twin: SensesOnDemand, real: Reading) -> tuple[Reading, str]:
        """Return the twin's reading at the recipe's pose, and how that pose was aligned.

        Raises NoImageError without a pose, and when the source returns no image in time.
        """
        request = self.mixer.pose_request
        assert request is not None  # noqa: S101 - on-demand twins have one
        if request.align == "interpolate":
            await self._await_pose(real.t_s)
        now_s = asyncio.get_running_loop().time()
        aligned = align_pose(request, self._poses, exposure_s=real.t_s, now_s=now_s)
        if aligned is None or aligned.t_s < self._requested_s:
            # Once a vehicle is silent its last pose is older than poses predicted from it.
            raise NoImageError("no pose for the exposure")
        self._requested_s = aligned.t_s
        reading = await twin.ask(
            aligned.pose,
            aligned.t_s,
            want_ids="ids" in self.mixer.needs,
            want_depth="depth" in self.mixer.needs,
        )
        self._require_in_time(asyncio.get_running_loop().time() - real.t_s)
        return replace(reading, sensor=self.mixer.sensor), aligned.how

    def _require_in_time(self, age_s: float) -> None:
        limit_s = self.mixer.combination.budget.max_latency_s
        if limit_s is not None and age_s > limit_s + _EARLY_S:
            age_ms = distinct_value_text(age_s * 1e3, limit_s * 1e3, digits=0)
            raise NoImageError(
                f"the twin's image came {age_ms} ms after the exposure, more than "
                f"max_latency_ms: {limit_s * 1e3:g}"
            )

    async def _await_pose(self, t_s: float) -> None:
        """Wait briefly for a pose after t_s, so that the pose at t_s can be interpolated."""
        loop = asyncio.get_running_loop()
        give_up_s = loop.time() + self._wait_s
        while self._poses.at(t_s).kind != "interpolated" and loop.time() < give_up_s:
            await sleep_until(loop.time() + _POSE_POLL_S)

    def _account(self, mixed: MixedReading[Reading], now_s: float) -> None:
        statistics, provenance = self.statistics, mixed.provenance
        if mixed.reading is not None:
            statistics.delivered(now_s)
        for samples, value in (
            (statistics.skew_ms, provenance.skew_ms),
            (statistics.latency_ms, provenance.latency_ms),
            (statistics.registration_error_px, provenance.registration_error_px),
            (statistics.registration_bound_px, provenance.registration_bound_px),
        ):
            if value is not None:
                samples.add(value)


def _delivered(
    mixed: MixedReading[Reading], delivered_s: float, *, mixing_s: float
) -> MixedReading[Reading]:
    """Return a mixture as of its delivery: on a clock that goes on, mixing took its time."""
    reading, provenance = mixed.reading, mixed.provenance
    if reading is not None:
        reading = replace(reading, arrived_s=delivered_s)
    if provenance.latency_ms is not None:
        latency_ms = provenance.latency_ms + mixing_s * 1e3
        provenance = replace(provenance, latency_ms=latency_ms)
    return MixedReading(reading, provenance)


def _is_big(reading: Reading) -> bool:
    """Return whether a reading is large, so that the mixing loop keeps only few: image, cloud."""
    return traits_of(type(reading)).is_large
