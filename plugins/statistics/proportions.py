"""Intervals of pass rates, and how many flights a claim needs; pure."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RateInterval:
    """A confidence interval; confidence: 0.95 for 95 %."""

    low: float
    high: float
    confidence: float

    @property
    def rate_text(self) -> str:
        """Return the interval of a rate as [low, high]; what only rounds to 0 or 1 has digits."""
        return f"[{_rate_text(self.low)}, {_rate_text(self.high)}]"


def _rate_text(rate: float) -> str:
    texts = [f"{rate:.{digits}f}" for digits in range(2, 8)]
    is_certain = rate in {0.0, 1.0}
    return next((text for text in texts if is_certain or 0.0 < float(text) < 1.0), texts[-1])


def clopper_pearson(passed: int, flown: int, *, confidence: float = 0.95) -> RateInterval | None:
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
    tail, failed = (1.0 - confidence) / 2.0, flown - passed
    low = _rate_of_tail(passed, flown, tail) if passed else 0.0
    high = 1.0 - _rate_of_tail(failed, flown, tail) if failed else 1.0
    return RateInterval(low, high, confidence)


def _rate_of_tail(passed: int, flown: int, tail: float) -> float:
    """Return the rate at which so many passes or more have the probability `tail`, by bisection."""
    low, high = 0.0, 1.0
    while low < (rate := (low + high) / 2.0) < high:
        if _binomial_tail(passed, flown, rate) < tail:
            low = rate
        else:
            high = rate
    return rate


def _binomial_tail(passed: int, flown: int, rate: float) -> float:
    """Return the probability of so many passes or more, of at least one, at a rate within (0, 1).

    From the mean on the terms of the binomial distribution decrease; below it the others are added.
    """
    if passed < rate * (flown + 1):
        return 1.0 - _added_terms(flown - passed + 1, flown, 1.0 - rate)
    return _added_terms(passed, flown, rate)


def _added_terms(passed: int, flown: int, rate: float) -> float:
    """Return the probability of so many passes or more, by the terms that matter."""
    failed = flown - passed
    ways = math.lgamma(flown + 1) - math.lgamma(passed + 1) - math.lgamma(failed + 1)
    term = math.exp(ways + passed * math.log(rate) + failed * math.log1p(-rate))
    added = 0.0
    for count in range(passed, flown + 1):
        added += term
        term *= (flown - count) / (count + 1) * rate / (1.0 - rate)
        if term <= added * 1e-18:
            break
    return added


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
