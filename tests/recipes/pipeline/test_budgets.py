"""Budgets: each limit by itself, and rates over a window."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.recipes.model.recipe import MixingBudget
from wil_campaign.recipes.pipeline.budgets import RateWatch, budget_breach
from wil_campaign.recipes.pipeline.mixture import Provenance

BUDGET = MixingBudget(0.06, 0.2, 10.0, 2.0)
GOOD = Provenance(1, 1.0, 2, 1.06, 60.0, 200.0, registration_error_px=2.0)


def test_readings_at_the_limits_are_no_breach() -> None:
    assert budget_breach(BUDGET, GOOD) is None
    assert budget_breach(MixingBudget(0.06), GOOD) is None


@pytest.mark.parametrize(
    ("reading", "said"),
    [
        (replace(GOOD, skew_ms=61.0), "max_skew_ms: 61, the limit is 60"),
        (replace(GOOD, latency_ms=250.0), "max_latency_ms: 250, the limit is 200"),
        (
            replace(GOOD, registration_error_px=2.5),
            "max_registration_error_px: 2.5, the limit is 2",
        ),
        (replace(GOOD, skew_ms=float("nan")), "max_skew_ms: nan, the limit is 60"),
        (replace(GOOD, skew_ms=100.0, latency_ms=900.0), "max_skew_ms: 100, the limit is 60"),
    ],
)
def test_each_limit_is_reported(reading: Provenance, said: str) -> None:
    assert str(budget_breach(BUDGET, reading)) == said


def test_one_reading_is_judged_by_its_provenance() -> None:
    told = Provenance(1, 1.0, 2, 1.01, 10.0, 150.0)
    assert budget_breach(BUDGET, told) is None
    assert budget_breach(BUDGET, replace(told, registration_error_px=1.5)) is None
    assert budget_breach(BUDGET, replace(told, registration_bound_px=1.5)) is None
    vague = replace(told, registration_bound_px=9.0)
    assert str(budget_breach(BUDGET, vague)).startswith("max_registration_error_px: 9")
    assert budget_breach(BUDGET, replace(vague, registration_error_px=1.5)) is None
    far = replace(told, registration_error_px=3.0)
    assert str(budget_breach(BUDGET, far)).startswith("max_registration_error_px: 3")
    assert str(budget_breach(BUDGET, replace(told, latency_ms=201.0))).startswith("max_latency_ms")
    assert budget_breach(MixingBudget(0.06), replace(told, latency_ms=9e9)) is None


def watched(rate_hz: float, seconds: float, *, stop_s: float = 1e9) -> list[bool]:
    """Watch deliveries of a rate, looking 20 times a second."""
    watch = RateWatch(BUDGET)
    watch.start(0.0)
    due, found = 0.0, []
    for tick in range(int(seconds * 20)):
        now_s = tick / 20
        while due <= min(now_s, stop_s):
            watch.delivered(due)
            due += 1 / rate_hz
        found.append(watch.breach(now_s) is not None)
    return found


@given(st.floats(10.0, 60.0))
def test_a_rate_at_or_above_the_limit_is_no_breach(rate_hz: float) -> None:
    assert not any(watched(rate_hz, 5.0))


@given(st.floats(0.5, 8.9))
def test_a_rate_below_the_limit_is_a_breach_within_a_window(rate_hz: float) -> None:
    found = watched(rate_hz, 5.0)
    assert not any(found[:20])
    assert any(found)


def test_a_source_that_stalls_is_noticed() -> None:
    found = watched(15.0, 5.0, stop_s=2.0)
    assert 2.0 < found.index(True) / 20 < 2.8


def test_nothing_is_watched_before_the_start_or_without_a_limit() -> None:
    assert RateWatch(BUDGET).breach(100.0) is None
    watch = RateWatch(MixingBudget(0.06))
    watch.start(0.0)
    assert watch.breach(100.0) is None
