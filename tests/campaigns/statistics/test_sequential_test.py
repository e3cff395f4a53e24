"""The sequential test of a pass rate, against its published properties."""

import numpy as np
import pytest

from campaigns.statistics.sequential_test import SequentialTest


def test_the_sequential_test_stops_when_it_knows() -> None:
    test = SequentialTest(at_least=0.95, against=0.8, most=60)
    assert test.least_flights == 18
    assert test.decided_after([True] * 60) == ("at least", 18)
    assert test.decided_after([False] * 60) == ("below", test.least_failures) == ("below", 3)
    assert test.decided_after([True] * 17) == ("undecided", 17)
    # One failure costs eight passes: 2.944 + 1.386 over 0.172.
    assert test.decided_after([False, *[True] * 59]) == ("at least", 27)
    short = SequentialTest(at_least=0.95, against=0.8, most=10)
    assert short.decided_after([True] * 60) == ("undecided", 10)


def test_the_sequential_test_errs_as_seldom_as_it_says() -> None:
    test = SequentialTest(at_least=0.95, against=0.8, most=400)
    rng = np.random.default_rng(5)

    def decided(rate: float) -> list[tuple[str, int]]:
        return [test.decided_after(list(rng.random(400) < rate)) for _ in range(800)]

    low, high = decided(0.8), decided(0.95)
    assert sum(one == "at least" for one, _ in low) / 800 < 0.06
    assert sum(one == "below" for one, _ in high) / 800 < 0.06
    assert np.mean([count for _, count in low]) == pytest.approx(23, abs=3)


@pytest.mark.parametrize("bad", [(0.8, 0.9, 5, 0.05), (1.0, 0.8, 5, 0.05), (0.9, 0.8, 0, 0.05)])
def test_a_sequential_test_that_cannot_be_is_refused(bad: tuple[float, float, int, float]) -> None:
    with pytest.raises(ValueError, match="needs"):
        SequentialTest(*bad)
