"""Intervals of pass rates, and how many flights a claim needs; pure."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Interval:
    """A confidence interval; confidence: 0.95 for 95 %."""

    low: float
    high: float
    confidence: float


def clopper_pearson(passed: int, flown: int, *, confidence: float = 0.95) -> Interval | None:
    """Return the exact two-sided interval of a pass rate; None without a flight.

    Clopper and Pearson, Biometrika 26 (1934): it covers the true rate at least with the confidence.
    Raises ValueError for impossible counts.
    """
    if not 0 <= passed <= flown:
        raise ValueError(f"{passed} of {flown} is not a count of passes")
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"the confidence must be between 0 and 1, is {confidence}")
    if flown == 0:
        return None
    from scipy.special import betaincinv

    tail, failed = (1.0 - confidence) / 2.0, flown - passed
    low = float(betaincinv(passed, failed + 1, tail)) if passed else 0.0
    high = float(betaincinv(passed + 1, failed, 1.0 - tail)) if failed else 1.0
    return Interval(low, high, confidence)


def flights_without_failure(pass_rate: float, *, confidence: float = 0.95) -> int:
    """Return how many flights, all passed, show a pass rate of at least `pass_rate`.

    One-sided: with a lower rate, so many passes in a row would have a probability below
    1 - confidence. Raises ValueError for a rate or confidence that is not between 0 and 1.
    """
    if not (0.0 < pass_rate < 1.0 and 0.0 < confidence < 1.0):
        raise ValueError("pass rate and confidence must be between 0 and 1")
    # The rounding error of the logarithms must not add a flight.
    return max(1, math.ceil(math.log(1.0 - confidence) / math.log(pass_rate) - 1e-9))


def least_pass_rate(flown: int, *, confidence: float = 0.95) -> float:
    """Return the least pass rate that so many flights, all passed, show; one-sided."""
    return (1.0 - confidence) ** (1.0 / flown) if flown else 0.0
