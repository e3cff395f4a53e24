"""Confidence intervals by resampling runs: bias-corrected and accelerated (BCa); pure.

Efron, JASA 82 (1987); over several samples as scipy.stats.bootstrap has it. A resample is a row
of weights for each sample: how often each of its runs was drawn, divided by their number.
"""

from collections.abc import Callable, Sequence
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from wil_campaign.plugins.statistics.proportions import RateInterval

F64 = NDArray[np.float64]
Statistic = Callable[[Sequence[F64]], F64]
"""Takes of each sample the weights (resamples, runs); returns a value for each resample."""

RESAMPLES = 9999
_NORMAL = NormalDist()


def bootstrap_interval(
    sizes: Sequence[int],
    statistic: Statistic,
    *,
    seed: int,
    confidence: float = 0.95,
    resamples: int = RESAMPLES,
) -> RateInterval | None:
    """Return the interval of a statistic over samples of so many runs each.

    None where it has no spread (equal runs, a single run in each sample) or no finite value: a
    width of zero would claim a knowledge that equal runs do not give.
    """
    rng = np.random.default_rng(seed)
    drawn = [rng.multinomial(n, np.full(n, 1.0 / n), size=resamples) / n for n in sizes]
    values = statistic(drawn)
    values = values[np.isfinite(values)]
    observed = float(statistic([np.full((1, n), 1.0 / n) for n in sizes])[0])
    scale = max(1e-12, abs(observed) * 1e-9)
    if len(values) < resamples // 2 or not np.isfinite(observed) or np.ptp(values) <= scale:
        return None
    below = np.mean(values < observed) / 2.0 + np.mean(values <= observed) / 2.0
    bias = _NORMAL.inv_cdf(min(max(float(below), 1.0 / resamples), 1.0 - 1.0 / resamples))
    acceleration = _acceleration(sizes, statistic)
    tail = (1.0 - confidence) / 2.0
    ends = []
    for share in (tail, 1.0 - tail):
        moved = bias + _NORMAL.inv_cdf(share)
        level = _NORMAL.cdf(bias + moved / (1.0 - acceleration * moved))
        ends.append(float(np.quantile(values, level)))
    return RateInterval(min(ends), max(ends), confidence)


def _acceleration(sizes: Sequence[int], statistic: Statistic) -> float:
    """Return the acceleration of the statistic, by the jackknife: one run left out at a time."""
    above = beneath = 0.0
    for place, count in enumerate(sizes):
        if count < 2:
            continue
        weights = [np.full((count, n), 1.0 / n) for n in sizes]
        weights[place] = (1.0 - np.eye(count)) / (count - 1)
        values = statistic(weights)
        influence = (count - 1) * (values.mean() - values)
        above += float(np.sum(influence**3)) / count**3
        beneath += float(np.sum(influence**2)) / count**2
    acceleration = above / (6.0 * beneath**1.5) if beneath > 0.0 else 0.0
    return acceleration if np.isfinite(acceleration) else 0.0
