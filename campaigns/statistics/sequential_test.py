"""The sequential probability ratio test of a pass rate, cut off after so many flights; pure.

Wald, Annals of Mathematical Statistics 16 (1945): after each flight the likelihoods of the two
rates are compared; beyond log((1 - error) / error) one of them is accepted. The probabilities of
both wrong decisions are at most twice `error` together, and each error / (1 - error): 5.3 % for
5 %. The cut-off adds none, but leaves some undecided.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from math import log
from typing import Literal

Decision = Literal["at least", "below", "undecided"]


@dataclass(frozen=True, slots=True)
class SequentialTest:
    """at_least: the pass rate that is claimed; against: the one that would be too low.

    most: flights after which it stays undecided. Raises ValueError unless against < at_least.
    """

    at_least: float
    against: float
    most: int
    error: float = 0.05

    def __post_init__(self) -> None:
        if not 0.0 < self.against < self.at_least < 1.0:
            raise ValueError("needs 0 < against < at_least < 1")
        if not 0.0 < self.error < 0.5:
            raise ValueError("needs an error between 0 and 0.5")
        if self.most < 1:
            raise ValueError("needs at least one flight")

    def decided_after(self, passes: Iterable[bool]) -> tuple[Decision, int]:
        """Return the decision on flights in their order, and the number of flights it needed.

        Flights after that do not change it. undecided: with the number of flights used.
        """
        passed, failed = _steps(self)
        threshold = log((1.0 - self.error) / self.error)
        ratio, count = 0.0, 0
        for each in passes:
            if count == self.most:
                break
            count += 1
            ratio += passed if each else failed
            if ratio >= threshold:
                return "at least", count
            if ratio <= -threshold:
                return "below", count
        return "undecided", count

    @property
    def least_flights(self) -> int:
        """Return how many flights decide for `at_least` when all pass; may be above `most`."""
        return _until(self, all_pass=True)

    @property
    def least_failures(self) -> int:
        """Return how many flights decide against it when all fail."""
        return _until(self, all_pass=False)


def _steps(test: SequentialTest) -> tuple[float, float]:
    """Return by how much a pass and a failure move the logarithm of the likelihood ratio."""
    passed = log(test.at_least / test.against)
    return passed, log((1.0 - test.at_least) / (1.0 - test.against))


def _until(test: SequentialTest, *, all_pass: bool) -> int:
    passed, failed = _steps(test)
    step = abs(passed if all_pass else failed)
    count = 1
    while count * step < log((1.0 - test.error) / test.error):
        count += 1
    return count
