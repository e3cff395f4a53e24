"""The gap between two modes, from values of the same variants under the same seeds; pure."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean, stdev

from campaigns.schema import Mode

LEAST_PAIRS = 3
"""Pairs of flights from which on the gap's spread is taken for measured."""
_CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class ModeGap:
    """The gap between a mode and a dearer one. differences: value there, less the value here."""

    lower: Mode
    upper: Mode
    differences: tuple[float, ...] = ()

    @property
    def is_measured(self) -> bool:
        """Return whether there are pairs enough to tell a spread."""
        return len(self.differences) >= LEAST_PAIRS

    @property
    def mean(self) -> float | None:
        """Return the mean difference; None without any."""
        return fmean(self.differences) if self.differences else None

    @property
    def spread(self) -> float | None:
        """Return the standard deviation of the differences; None below two."""
        return stdev(self.differences) if len(self.differences) > 1 else None

    def least_above(self, value: float) -> float:
        """Return what a value of the lower mode is at least in the upper one, by prediction.

        One-sided 95 % prediction of one further difference (Student's t); minus infinity where the
        gap is not measured.
        """
        mean, spread, count = self.mean, self.spread, len(self.differences)
        if mean is None or spread is None or not self.is_measured:
            return -math.inf
        quantile = _t_quantile(count - 1)
        return value + mean - quantile * spread * math.sqrt(1.0 + 1.0 / count)


def passed_on(
    values: Sequence[tuple[str, float]], gap: ModeGap, *, probes: int, most: int
) -> list[str]:
    """Return which variants are flown in the upper mode next, the worst first.

    values: of those not flown there yet, in the lower mode. Until the gap is measured these are
    the worst ones, enough to measure it; afterwards those that may fail there by prediction.
    """
    ordered = sorted(values, key=lambda one: one[1])
    if not gap.is_measured:
        return [name for name, _ in ordered[: min(most, max(probes, LEAST_PAIRS))]]
    doubtful = [name for name, value in ordered if gap.least_above(value) <= 0.0]
    return doubtful[:most]


def _t_quantile(degrees: int) -> float:
    """Return the one-sided quantile of Student's t distribution."""
    from scipy.special import stdtrit  # noqa: PLC0415 - takes half a second

    return float(stdtrit(degrees, _CONFIDENCE))
