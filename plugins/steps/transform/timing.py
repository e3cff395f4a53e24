"""Transforms in time: resampling to the other side's times, and delay."""

from bisect import bisect_left, bisect_right
from typing import Annotated

from pydantic import Field

from wil_campaign.plugins.steps.operations.interpolation import INTERPOLATED, interpolated_reading
from wil_campaign.recipes.model.registry import EVERY_SENSOR, SidedParameters, StepContext, step
from wil_campaign.recipes.working import Align, AnyMasked, CannotMixError, Masked, TimedOperator
from wil_campaign.vehicles.readings import (
    CameraReading,
    DepthReading,
    LidarPointsReading,
    Reading,
)
from wil_campaign.worlds.figures import distinct_value_text

_KEPT = 4096
"""Largest number of stored readings: 10 s, the longest delay, of an IMU at 400 Hz."""
_KEPT_BIG = 320
"""The same of delayed images and clouds: 10 s at 30 Hz, and never more than the delay spans."""
_KEPT_AROUND = 16
"""The same of images and clouds for resampling."""
_BEHIND_S = 1.0
"""How far a mixture may be behind the newest reading: the other side's come later."""


class _Memory:
    """The last readings of one side by time, for steps that select by timing."""

    def __init__(self, size: int, span_s: float) -> None:
        self._size = size
        self._span_s = span_s
        self._readings: list[Reading] = []
        self._times: list[float] = []

    def add(self, reading: Reading) -> None:
        """Add a reading newer than all before to the timing memory; others change nothing."""
        if self._times and reading.t_s <= self._times[-1]:
            return
        self._readings.append(reading)
        self._times.append(reading.t_s)
        # One reading beyond the span is kept: `around` returns the one before a time.
        old = bisect_left(self._times, reading.t_s - self._span_s) - 1
        excess = max(old, len(self._times) - self._size)
        if excess > 0:
            del self._readings[:excess], self._times[:excess]

    @property
    def newest(self) -> Reading | None:
        """Return the newest reading in the timing memory; None when it is empty."""
        return self._readings[-1] if self._readings else None

    def around(self, t_s: float) -> tuple[Reading | None, Reading | None]:
        before, after = bisect_right(self._times, t_s), bisect_left(self._times, t_s)
        return (
            self._readings[before - 1] if before else None,
            self._readings[after] if after < len(self._readings) else None,
        )


def _memory(reading: Reading, span_s: float, kept_big: int) -> _Memory:
    """Return a timing memory for readings of this type; fewer for images and clouds."""
    big = isinstance(reading, CameraReading | DepthReading | LidarPointsReading)
    return _Memory(kept_big if big else _KEPT, span_s)


class _Remembering(TimedOperator):
    """A timing step that remembers what is `span_s` older than a reading that is mixed.

    kept_big: how many large ones at most.
    """

    def __init__(self, span_s: float, kept_big: int) -> None:
        self._span_s = span_s + _BEHIND_S
        self._kept_big = kept_big
        self._memory: _Memory | None = None

    def offer(self, reading: Reading) -> Reading | None:
        """Store a reading of this side; the next step receives the same one."""
        self._remember(reading)
        return reading

    def _remember(self, reading: Reading) -> _Memory:
        if self._memory is None:
            self._memory = _memory(reading, self._span_s, self._kept_big)
        self._memory.add(reading)
        return self._memory


class ResampleParameters(SidedParameters):
    """Which reading is used at the other side's time, and how far away it may be.

    how: `latest` uses the newest reading; `hold` the last one at or before the other side's;
    `interpolate` interpolates between the two around it.
    max_gap_ms: between the reading used and the other side's time, or between the two around it.
    """

    shorthand = "how"
    timed = True

    how: Align = "hold"
    max_gap_ms: Annotated[float, Field(gt=0, le=60_000)] = 1000.0

    def refuses(self, kind: str) -> str:
        """Return why a sensor's readings cannot be interpolated in time."""
        if self.how == "interpolate" and kind not in INTERPOLATED:
            return f"readings of a {kind} cannot be interpolated; use hold or latest"
        return ""


@step("resample", stage="transform", sensors=EVERY_SENSOR, parameters=ResampleParameters)
def resample(parameters: ResampleParameters, context: StepContext) -> TimedOperator:  # noqa: ARG001 - the interface of steps
    """Give one side's readings at the times of the other's: latest, hold, or interpolate.

    Times in seconds of the run clock. An interpolated reading has the other's time, others keep
    their own, so that the skew shows the difference. Beyond the gap the overlay is dropped.
    """
    return _Resample(parameters.how, parameters.max_gap_ms / 1000.0)


class _Resample(_Remembering):
    """The step `resample`: selects or interpolates readings by timing."""

    def __init__(self, how: Align, max_gap_s: float) -> None:
        super().__init__(max_gap_s, _KEPT_AROUND)
        self._how = how
        self._max_gap_s = max_gap_s

    def __call__(self, work: AnyMasked, other: AnyMasked | None) -> AnyMasked:
        memory = self._remember(work.reading)
        if other is None:
            return work
        t_s: float = other.reading.t_s
        found = self._find_reading(memory, t_s)
        gap_s = abs(found.t_s - t_s)
        if gap_s > self._max_gap_s:
            limit_ms = self._max_gap_s * 1000
            gap = distinct_value_text(gap_s * 1000, limit_ms, digits=0)
            away = f"resample: the reading is {gap} ms away"
            raise CannotMixError("stale", f"{away}, more than max_gap_ms {limit_ms:g}")
        return Masked(found, work.mask) if found is not work.reading else work

    def _find_reading(self, memory: _Memory, t_s: float) -> Reading:
        """Return the reading for a time: latest, held, or interpolated."""
        before, after = memory.around(t_s)
        if self._how == "latest":
            before = memory.newest
        elif self._how == "interpolate":
            made = _interpolate_readings(before, after, t_s, self._max_gap_s)
            before = made or before or after
        if before is None:
            raise CannotMixError("no_history", f"resample: no reading at or before {t_s:.3f} s")
        return before


def _interpolate_readings(
    before: Reading | None, after: Reading | None, t_s: float, max_gap_s: float
) -> Reading | None:
    """Return the reading interpolated at a time; None when the gap is too long."""
    if before is None or after is None or after.t_s - before.t_s > max_gap_s:
        return None
    return before if after.t_s == before.t_s else interpolated_reading(before, after, t_s)


class DelayParameters(SidedParameters):
    """by_ms: least age of the used reading relative to the newest one."""

    shorthand = "by_ms"
    timed = True

    by_ms: Annotated[float, Field(ge=0, le=10_000)]


@step("delay", stage="transform", sensors=EVERY_SENSOR, parameters=DelayParameters)
def delay(parameters: DelayParameters, context: StepContext) -> TimedOperator:  # noqa: ARG001 - the interface of steps
    """Delay one side: use its newest reading that is at least so much older than the latest.

    Times in seconds of the run clock; the reading keeps its own, so that skew and latency show
    the delay. Until the side has sent readings for so long, there is none ("no_history").
    """
    return _Delay(parameters.by_ms / 1000.0)


class _Delay(_Remembering):
    """The step `delay`: selects the newest reading that is old enough."""

    def __init__(self, by_s: float) -> None:
        super().__init__(by_s, _KEPT_BIG)
        self._by_s = by_s

    def offer(self, reading: Reading) -> Reading | None:
        """Store a reading; the next step receives the newest one that is old enough."""
        return self._remember(reading).around(reading.t_s - self._by_s + 1e-9)[0]

    def __call__(self, work: AnyMasked, other: AnyMasked | None) -> AnyMasked:  # noqa: ARG002 - the interface
        found = self.offer(work.reading)
        if found is None:
            raise CannotMixError("no_history", f"delay: nothing is {self._by_s * 1000:.0f} ms old")
        return work if found is work.reading else Masked(found)
