"""The gap between two modes: differences of the same variants under the same seeds; pure."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean, stdev

from wil_campaign.campaigns.schema import Mode

LEAST_PAIRS = 3
"""Least number of pairs of flights from which the gap's spread is estimated."""
_CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class ModeGap:
    """The gap between a mode and a costlier one. differences: upper value minus lower value."""

    lower: Mode
    upper: Mode
    differences: tuple[float, ...] = ()

    @property
    def is_measured(self) -> bool:
        """Return whether there are enough pairs to estimate the spread."""
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
        """Return the lower prediction bound in the upper mode for a value of the lower one.

        One-sided 95 % prediction of one further difference (Student's t); minus infinity where the
        gap is not measured.
        """
        mean, spread, count = self.mean, self.spread, len(self.differences)
        if mean is None or spread is None or not self.is_measured:
            return -math.inf
        quantile = _t_quantile(count - 1)
        return value + mean - quantile * spread * math.sqrt(1.0 + 1.0 / count)


def variants_passed_on(
    values: Sequence[tuple[str, float]], gap: ModeGap, *, probes: int, most: int
) -> list[str]:
    """Return the variants to be flown next in the upper mode, the worst first.

    values: in the lower mode, of variants not flown in the upper one yet. Until the gap is measured
    the result is as many of the worst as that needs; then those that may fail by prediction.
    """
    ordered = sorted(values, key=lambda one: one[1])
    if not gap.is_measured:
        return [name for name, _ in ordered[: min(most, max(probes, LEAST_PAIRS))]]
    doubtful = [name for name, value in ordered if gap.least_above(value) <= 0.0]
    return doubtful[:most]


def _t_quantile(degrees: int) -> float:
    """Return the one-sided quantile of Student's t distribution."""
    from scipy.special import stdtrit

    return float(stdtrit(degrees, _CONFIDENCE))
