"""Axes: limits and ticks at round numbers; pure."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

_LEAST_SPAN = 1e-6


@dataclass(frozen=True, slots=True)
class AxisScale:
    """An axis from low to high, with ticks in between."""

    low: float
    high: float
    ticks: tuple[float, ...]

    def share(self, value: float) -> float:
        """Return where a value lies, 0 at low and 1 at high; not clamped."""
        return (value - self.low) / (self.high - self.low)

    def tick_text(self, tick: float) -> str:
        """Return a tick's label."""
        return f"{tick:g}" if abs(tick) >= _LEAST_SPAN else "0"


def tick_step(span: float, about: int) -> float:
    """Return a round step (1, 2 or 5 times a power of ten) for about that many ticks."""
    raw = max(span, _LEAST_SPAN) / max(1, about)
    power = 10.0 ** math.floor(math.log10(raw))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= raw * 0.999)


def ticks_within(low: float, high: float, about: int) -> tuple[float, ...]:
    """Return the round numbers between two values."""
    step = tick_step(high - low, about)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return tuple(round(index * step, 9) for index in range(first, min(last, first + 200) + 1))


def value_scale(values: Iterable[float], about: int = 3) -> AxisScale:
    """Return an axis that contains all values and ends at round numbers."""
    finite = [value for value in values if math.isfinite(value)] or [0.0, 1.0]
    low, high = min(finite), max(finite)
    if high - low < _LEAST_SPAN:
        low, high = low - 0.5, high + 0.5
    step = tick_step(high - low, about)
    low, high = math.floor(low / step) * step, math.ceil(high / step) * step
    return AxisScale(low, high, ticks_within(low, high, about))
