"""Exact tests of pass rates: Fisher's, and its stratified form; pure, in whole numbers.

Conditional on all margins the passes of the first sample are hypergeometric. With strata (the
cases of a campaign) the sum of them is tested: Mehta, Patel and Gray, JASA 80 (1985), the exact
form of the test of Cochran, Mantel and Haenszel.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import comb
from typing import Literal

Alternative = Literal["two-sided", "less"]


@dataclass(frozen=True, slots=True)
class Counts:
    """Passes and flights of one sample."""

    passed: int
    flown: int

    def __post_init__(self) -> None:
        if not 0 <= self.passed <= self.flown:
            raise ValueError(f"{self.passed} of {self.flown} is not a count of passes")


Table = tuple[Counts, Counts]
"""Two samples of one stratum."""


def fisher_exact(first: Counts, second: Counts, alternative: Alternative = "two-sided") -> float:
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
    lowest = sum(max(0, one.passed + other.passed - other.flown) for one, other in given)
    observed = sum(first.passed for first, _ in given) - lowest
    if alternative == "less":
        chosen = sum(weights[: observed + 1])
    else:
        chosen = sum(weight for weight in weights if weight <= weights[observed])
    return float(Fraction(chosen, sum(weights)))


def _hypergeometric(first: Counts, second: Counts) -> list[int]:
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
