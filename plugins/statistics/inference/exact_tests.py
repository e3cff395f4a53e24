"""Exact tests of pass rates: Fisher's, and its stratified form; pure, in whole numbers.

Conditional on all margins the passes of the first sample are hypergeometric. With strata (the
cases of a campaign) the sum of them is tested: Mehta, Patel and Gray, JASA 80 (1985), the exact
form of the test of Cochran, Mantel and Haenszel. For very many flights whole numbers take minutes;
`stratified_rounded` computes the same in floating point.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import comb
from typing import Literal

import numpy as np
from numpy.typing import NDArray

_ROUNDING = 1e-9
_IMPROBABLE = 1e-20
"""Probabilities below it change no p that anyone reads."""

Alternative = Literal["two-sided", "less"]


@dataclass(frozen=True, slots=True)
class PassCounts:
    """Passes and flights of one sample."""

    passed: int
    flown: int

    def __post_init__(self) -> None:
        if not 0 <= self.passed <= self.flown:
            raise ValueError(f"{self.passed} of {self.flown} is not a count of passes")


Table = tuple[PassCounts, PassCounts]
"""Two samples of one stratum."""


def fisher_exact(
    first: PassCounts, second: PassCounts, alternative: Alternative = "two-sided"
) -> float:
    """Return Fisher's p. less: that the first sample's pass rate is below the second's."""
    return stratified_exact([(first, second)], alternative)


def stratified_exact(tables: Iterable[Table], alternative: Alternative = "two-sided") -> float:
    """Return the exact p of a common odds ratio of 1 over all strata.

    two-sided: the probability of all outcomes that are no more probable than the one observed.
    less: that the first samples' pass rates are below the second's. 1 where nothing can differ.
    """
    given = list(tables)
    weights = [1]
    for first, second in given:
        weights = _convolved(weights, _hypergeometric(first, second))
    lowest = sum(max(0, counts.passed + other.passed - other.flown) for counts, other in given)
    observed = sum(first.passed for first, _ in given) - lowest
    if alternative == "less":
        chosen = sum(weights[: observed + 1])
    else:
        chosen = sum(weight for weight in weights if weight <= weights[observed])
    return float(Fraction(chosen, sum(weights)))


def stratified_rounded(tables: Iterable[Table]) -> float:
    """Return the two-sided p of `stratified_exact` in floating point, to about nine digits.

    For planned numbers of flights, of which whole numbers have thousands of digits.
    """
    lowest, shares = 0, np.ones(1)
    observed = 0
    for first, second in tables:
        least, more = _hypergeometric_shares(first, second)
        lowest, shares = lowest + least, np.convolve(shares, more)
        observed += first.passed
    at = observed - lowest
    if not 0 <= at < len(shares):
        return 0.0
    # Equal probabilities differ by rounding.
    chosen = shares[shares <= shares[at] * (1.0 + _ROUNDING)]
    return min(1.0, float(chosen.sum() / shares.sum()))


def _hypergeometric_shares(
    first: PassCounts, second: PassCounts
) -> tuple[int, NDArray[np.float64]]:
    """Return the probability of each number of passes of the first sample, and the least number.

    Improbable numbers at both ends are left out.
    """
    passed = first.passed + second.passed
    least, most = max(0, passed - second.flown), min(first.flown, passed)
    counts = np.arange(least, most, dtype=np.float64)
    # Ratio of each probability to the one before it.
    ratios = (first.flown - counts) * (passed - counts)
    ratios /= (counts + 1.0) * (second.flown - passed + counts + 1.0)
    logs = np.concatenate([[0.0], np.cumsum(np.log(ratios))])
    shares = np.exp(logs - logs.max())
    shares /= shares.sum()
    kept = np.flatnonzero(shares > _IMPROBABLE)
    return least + int(kept[0]), shares[kept[0] : kept[-1] + 1]


def _hypergeometric(first: PassCounts, second: PassCounts) -> list[int]:
    """Return the weight of each number of passes of the first sample, from the least possible."""
    passed = first.passed + second.passed
    least, most = max(0, passed - second.flown), min(first.flown, passed)
    return [
        comb(first.flown, count) * comb(second.flown, passed - count)
        for count in range(least, most + 1)
    ]


def _convolved(one: Sequence[int], other: Sequence[int]) -> list[int]:
    """Return the weights of the sum of two independent numbers."""
    found = [0] * (len(one) + len(other) - 1)
    for shift, weight in enumerate(one):
        for index, more in enumerate(other):
            found[shift + index] += weight * more
    return found
