"""Intervals of pass rates, against published values."""

import time

import pytest

from wil_campaign.plugins.statistics.proportions import (
    clopper_pearson,
    flights_without_failure,
    least_pass_rate,
)


@pytest.mark.parametrize(
    ("passed", "flown", "low", "high"),
    [
        # Newcombe, Statistics in Medicine 17 (1998), table I, method 5.
        (81, 263, 0.2527, 0.3676),
        (15, 148, 0.0578, 0.1617),
        (0, 20, 0.0000, 0.1684),
        (1, 29, 0.0009, 0.1776),
        (5, 5, 0.4782, 1.0000),
    ],
)
def test_the_interval_of_a_pass_rate_is_as_published(
    passed: int, flown: int, low: float, high: float
) -> None:
    interval = clopper_pearson(passed, flown)
    assert interval is not None
    assert (interval.low, interval.high) == pytest.approx((low, high), abs=6e-5)


def test_the_interval_of_very_many_flights_takes_no_time() -> None:
    """Where the tail is 0 to the last digit, all of its terms are: they were added for 6 s."""
    begin_s = time.process_time()
    found = clopper_pearson(3_333_333, 10_000_000)
    assert time.process_time() - begin_s < 2.0
    assert found is not None
    assert (found.low, found.high) == pytest.approx((0.3330411241, 0.3336255724), abs=1e-9)


def test_the_interval_of_a_pass_rate_is_scipys() -> None:
    from scipy.special import betaincinv

    for passed, flown in [
        (1, 1),
        (1, 2),
        (3, 7),
        (17, 20),
        (1, 1000),
        (412, 1000),
        (99_990, 100_000),
    ]:
        for confidence in (0.8, 0.95, 0.999):
            interval = clopper_pearson(passed, flown, confidence=confidence)
            tail, failed = (1.0 - confidence) / 2.0, flown - passed
            low = betaincinv(passed, failed + 1, tail)
            high = betaincinv(passed + 1, failed, 1.0 - tail) if failed else 1.0
            assert interval is not None
            assert (interval.low, interval.high) == pytest.approx((low, high), rel=1e-12)


def test_no_flight_has_no_interval_and_impossible_counts_are_refused() -> None:
    assert clopper_pearson(0, 0) is None
    with pytest.raises(ValueError, match="6 of 5"):
        clopper_pearson(6, 5)
    with pytest.raises(ValueError, match="confidence"):
        clopper_pearson(1, 5, confidence=1.0)


def test_a_claim_needs_so_many_flights_without_failure() -> None:
    assert [flights_without_failure(rate) for rate in (0.8, 0.9, 0.95, 0.99)] == [14, 29, 59, 299]
    assert least_pass_rate(59) >= 0.95 > least_pass_rate(58)
    assert least_pass_rate(0) == 0.0


@pytest.mark.parametrize(
    ("passed", "flown", "text"),
    [
        (5, 5, "[0.48, 1.00]"),
        (1000, 1000, "[0.996, 1.00]"),
        (1, 1000, "[0.00003, 0.01]"),
        (0, 1000, "[0.00, 0.004]"),
    ],
)
def test_no_end_of_a_rate_is_shown_as_certain_by_rounding(
    passed: int, flown: int, text: str
) -> None:
    interval = clopper_pearson(passed, flown)
    assert interval is not None
    assert interval.rate_text == text
