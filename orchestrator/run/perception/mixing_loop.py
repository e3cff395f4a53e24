"""Mixing while flying: each real reading is met by the twin's of the same moment and pose."""

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

from orchestrator.run.perception.mixing_statistics import MixingStatistics
from orchestrator.run.perception.visibility import VisibilityProbe
from orchestrator.state.mixtures import MixedFrame
from recipes.pipeline.alignment import align_pose
from recipes.pipeline.mixture import Mixed
from recipes.pipeline.pipeline import Mixer
from vehicles.cameras.rendered_cameras import NoImageError, sleep_until
from vehicles.poses.pose_history import PoseHistory
from vehicles.readings import CameraReading, DepthReading, LidarPointsReading, Reading
from vehicles.sensors.sensor_streams import OnDemand

_POSE_POLL_S = 0.002
_PAIR_WAIT_S = 0.05
"""How long a reading waits for the twin's of its moment, where the twin's source is not asked."""
_WAITING_BIG = 1
_WAITING_SMALL = 32
"""Readings that wait to be mixed: a late picture is not worth having, while readings of a few
bytes come in bursts when the loop was busy."""
_KEPT_BIG = 8
_KEPT_SMALL = 64
"""Readings of the twin among which that of a moment is sought."""
_EARLY_S = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class _Waiting:
    """A real reading in the order of its arrival. is_due: it is mixed; others are but offered."""

    reading: Reading
    is_due: bool


@dataclass(frozen=True, slots=True)
class RegistrationError:
    """A mixture's registration error, RMS in pixels; None: nothing virtual in view.

    error_px: against an independent reference; None without one. bound_px: without one, what the
    error is within by what is known of the pose. unbounded: why nothing is known of it, in words.
    """

    error_px: float | None = None
    bound_px: float | None = None
    unbounded: str = ""


Registration = Callable[[Reading, float], RegistrationError]
"""The twin's reading, and the exposure of the real one that it was laid over."""


class MixingLoop:
    """Mixes the readings of one sensor in a loop and reports each mixture.

    name: of the combination. twin: a source that is asked for the pose that the recipe's
    `register` wants; None where the twin's readings come by themselves (`twin_reading`). poses: of
    the vehicle from whose place it is asked. wait_s: how long a pose for the exposure is waited
    for. period_s: of the real readings; none waits longer for the twin's. rate_hz: at most so
    many mixtures on average, each of the reading that is nearest to its time; None for each real
    reading. registration: tells how far off a twin's picture is;
    None for sensors without pixels. probe: measures what a mixture shows; None where
    that cannot be, and `unmeasured` says why. tell: takes each mixture, also
    one that is none. trouble: told what is wrong with a reading. A real reading that finds too
    many waiting replaces the oldest, which counts as dropped; so does one for which the twin's
    source gives no image, or gives it later than the recipe's max_latency_ms: a camera, too, loses
    a frame here and there. Ends by StepError when a step fails.
    """

    def __init__(
        self,
        *,
        name: str,
        mixer: Mixer,
        twin: OnDemand | None,
        poses: PoseHistory,
        wait_s: float,
        period_s: float,
        rate_hz: float | None,
        registration: Registration | None,
        probe: VisibilityProbe | None = None,
        unmeasured: str = "",
        tell: Callable[[MixedFrame], None],
        trouble: Callable[[str], None],
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
        self._drawn_s = 0.0
        self._registration = registration
        self.probe = probe
        self.unmeasured = unmeasured
        self._tell = tell
        self._trouble = trouble
        self._waiting: deque[_Waiting] = deque()
        self._is_mixing = False
        self._twins: deque[Reading] = deque(maxlen=_KEPT_SMALL)
        self._arrived = asyncio.Event()

    def real_reading(self, reading: Reading) -> None:
        """Take the real sensor's reading into the mixing loop."""
        is_due = self._is_due(reading)
        if not (is_due or self._is_mixing or self._waiting):
            self.mixer.offer("real", reading)
            return
        # Behind those that wait: a step that chooses by time sees all in their order.
        self._make_way(is_due=is_due, is_big=_is_big(reading))
        self._waiting.append(_Waiting(reading, is_due))
        self._arrived.set()

    def _make_way(self, *, is_due: bool, is_big: bool) -> None:
        """Let the oldest reading of a kind go where as many wait as may."""
        if is_due:
            most = _WAITING_BIG if is_big else _WAITING_SMALL
        else:
            most = _KEPT_BIG if is_big else _KEPT_SMALL
        alike = [one for one in self._waiting if one.is_due is is_due]
        if len(alike) >= most:
            self._waiting.remove(alike[0])
            self.statistics.replaced += is_due

    def _is_due(self, reading: Reading) -> bool:
        """Return whether a reading is due for mixing: on average at the recipe's rate.

        One that is nearer to its time than the next would be counts, so that a camera at the
        recipe's own rate loses nothing by the jitter of its stamps.
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
        fault = self.mixer.offer("twin", reading)
        if fault is not None:
            self._trouble(fault)
            return
        if _is_big(reading) and len(self._twins) >= _KEPT_BIG:
            self._twins.popleft()
        self._twins.append(reading)
        self._arrived.set()

    async def run(self) -> None:
        """Mix readings until cancelled."""
        while True:
            await self._arrived.wait()
            self._arrived.clear()
            self._is_mixing = True
            while self._offer_readings_before_due():
                await self._mix()
            self._is_mixing = False

    def _offer_readings_before_due(self) -> bool:
        """Offer what waits before the next reading that is due; return whether there is one."""
        while self._waiting and not self._waiting[0].is_due:
            self.mixer.offer("real", self._waiting.popleft().reading)
        return bool(self._waiting)

    def _next_due(self) -> Reading:
        self._offer_readings_before_due()
        return self._waiting.popleft().reading

    async def _mix(self) -> None:
        if self._twin is None:
            await self._twin_has_come()
            real = self._next_due()
            twin, alignment = self._nearest(real.t_s), "as it came"
        else:
            real = self._next_due()
            try:
                twin, alignment = await self._ask_twin(self._twin, real)
            except NoImageError as error:
                self.statistics.miss(str(error))
                return
        now_s = asyncio.get_running_loop().time()
        if self.probe is not None:
            self.probe.begin()
        mixed: Mixed[Reading] = self.mixer.mix(real, twin, now_s=now_s, alignment=alignment)
        visibility = None if self.probe is None else self.probe.measure(mixed)
        unbounded = ""
        if self._registration is not None and twin is not None:
            told = mixed.provenance
            # A step may have chosen an older picture of the real camera.
            exposed_s = real.t_s if told.real_t_s is None else told.real_t_s
            found = self._registration(twin, exposed_s)
            told = replace(
                told,
                registration_error_px=found.error_px,
                registration_bound_px=found.bound_px,
            )
            mixed = Mixed(mixed.reading, told)
            unbounded = found.unbounded
            self.statistics.unbounded = unbounded or self.statistics.unbounded
        self._account(mixed, now_s)
        frame = MixedFrame(self.name, self.mixer.sensor, real, twin, mixed, visibility, unbounded)
        self._tell(frame)

    async def _twin_has_come(self) -> None:
        """Wait until twin readings have reached the oldest real one that waits to be mixed.

        While this waits that reading may be replaced by a newer one.
        """
        if self._twin_is_there():
            return
        give_up_s = asyncio.get_running_loop().time() + self._pair_wait_s
        try:
            async with asyncio.timeout_at(give_up_s):
                while not self._twin_is_there():
                    self._arrived.clear()
                    await self._arrived.wait()
        except TimeoutError:
            return

    def _twin_is_there(self) -> bool:
        oldest_s = next(one.reading.t_s for one in self._waiting if one.is_due)
        return bool(self._twins) and self._twins[-1].t_s >= oldest_s - _EARLY_S

    def _nearest(self, t_s: float) -> Reading | None:
        return min(self._twins, key=lambda reading: abs(reading.t_s - t_s), default=None)

    async def _ask_twin(self, twin: OnDemand, real: Reading) -> tuple[Reading, str]:
        """Return the twin's reading at the recipe's pose to mix, and how that was found.

        Raises NoImageError without a pose to ask for, and when its source gives none, or gives it
        too late.
        """
        request = self.mixer.pose_request
        assert request is not None  # noqa: S101 - who asks has a request
        if request.align == "interpolate":
            await self._pose_has_come(real.t_s)
        now_s = asyncio.get_running_loop().time()
        found = align_pose(request, self._poses, exposure_s=real.t_s, now_s=now_s)
        if found is None or found.t_s < self._drawn_s:
            # A silent vehicle's last pose is older than what was predicted from it meanwhile.
            raise NoImageError("no pose for the exposure")
        self._drawn_s = found.t_s
        reading = await twin.ask(
            found.pose,
            found.t_s,
            want_ids="ids" in self.mixer.needs,
            want_depth="depth" in self.mixer.needs,
        )
        self._require_in_time(asyncio.get_running_loop().time() - real.t_s)
        return replace(reading, sensor=self.mixer.sensor), found.how

    def _require_in_time(self, age_s: float) -> None:
        limit_s = self.mixer.combination.budget.max_latency_s
        if limit_s is not None and age_s > limit_s + _EARLY_S:
            raise NoImageError(
                f"the twin's image came {age_s * 1e3:.0f} ms after the exposure, more than "
                f"max_latency_ms: {limit_s * 1e3:.0f}"
            )

    async def _pose_has_come(self, t_s: float) -> None:
        """Wait briefly until the pose source has passed t_s, so that mixing can align."""
        loop = asyncio.get_running_loop()
        give_up_s = loop.time() + self._wait_s
        while self._poses.at(t_s).kind != "interpolated" and loop.time() < give_up_s:
            await sleep_until(loop.time() + _POSE_POLL_S)

    def _account(self, mixed: Mixed[Reading], now_s: float) -> None:
        statistics, provenance = self.statistics, mixed.provenance
        if mixed.reading is not None:
            statistics.delivered(now_s)
        if provenance.skew_ms is not None:
            statistics.skew_ms.add(provenance.skew_ms)
        if provenance.latency_ms is not None:
            statistics.latency_ms.add(provenance.latency_ms)
        if provenance.registration_error_px is not None:
            statistics.registration_error_px.add(provenance.registration_error_px)
        if provenance.registration_bound_px is not None:
            statistics.registration_bound_px.add(provenance.registration_bound_px)


def _is_big(reading: Reading) -> bool:
    """Return whether the mixing loop keeps few readings of this size: images, clouds."""
    return isinstance(reading, CameraReading | DepthReading | LidarPointsReading)
