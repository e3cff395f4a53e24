"""Stamps of a sender on the run clock."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.vehicles.sources.arrival_clock import ArrivalClock


@given(
    offset_s=st.floats(-1e6, 1e6),
    delays_s=st.lists(st.floats(0.0, 0.5), min_size=1, max_size=50),
)
def test_nothing_is_sampled_after_it_arrived(offset_s: float, delays_s: list[float]) -> None:
    clock = ArrivalClock()
    for k, delay_s in enumerate(delays_s):
        arrived_s = 0.1 * k + delay_s
        assert clock.run_time(0.1 * k + offset_s, arrived_s) <= arrived_s + 1e-6


def test_jitter_is_taken_out_and_latency_put_in() -> None:
    rng = np.random.default_rng(1)
    clock = ArrivalClock(latency_s=0.05)
    errors = []
    for k in range(400):
        sampled_s = k / 100
        arrived_s = sampled_s + 0.05 + float(rng.exponential(0.01))
        errors.append(clock.run_time(sampled_s + 1234.5, arrived_s) - sampled_s)
    assert max(map(abs, errors[50:])) < 0.001


def test_a_drifting_clock_is_followed() -> None:
    clock = ArrivalClock(window_s=5.0)
    for k in range(6000):
        sampled_s = k / 100
        found_s = clock.run_time(sampled_s * (1 + 1e-4), sampled_s + 0.001 * (k % 7))
        assert abs(found_s - sampled_s) < 0.003


@pytest.mark.parametrize("grows", [0.01, 0.03, 0.05])
def test_what_a_buffer_that_fills_delays_is_old(grows: float) -> None:
    """By the last seconds alone it was as new as ever: after five minutes late by nine seconds."""
    clock = ArrivalClock()
    for k in range(30 * 300):
        sampled_s = k / 30
        found_s = clock.run_time(sampled_s + 50.0, sampled_s * (1 + grows))
        assert -1e-6 < found_s - sampled_s < 0.35
    assert clock.resets == 0
    # The buffer is emptied: what comes then is new, and no new start of the sender.
    assert clock.run_time(370.0, 320.0) == pytest.approx(320.0)
    assert clock.resets == 0


@pytest.mark.parametrize("jump_s", [-50.0, -0.5, 3.0, 1e5])
def test_a_sender_that_starts_anew_is_taken_as_it_is(jump_s: float) -> None:
    clock = ArrivalClock()
    clock.run_time(100.0, 1.0)
    assert clock.run_time(100.1, 1.1) == pytest.approx(1.1)
    assert clock.run_time(100.2 + jump_s, 1.2) == pytest.approx(1.2)
    assert clock.resets == 1


def test_a_late_sample_is_late_and_not_a_new_start() -> None:
    clock = ArrivalClock()
    clock.run_time(100.0, 1.0)
    assert clock.run_time(101.0, 4.0) == pytest.approx(2.0)
    assert clock.resets == 0


@pytest.mark.parametrize("stamp", [None, float("nan"), float("inf")])
def test_without_a_stamp_the_arrival_counts(stamp: float | None) -> None:
    assert ArrivalClock(latency_s=0.1).run_time(stamp, 5.0) == pytest.approx(4.9)


def test_stamps_that_go_back_a_little_are_no_restarts() -> None:
    """As of two bodies of one frame, each in a message of its own."""
    clock = ArrivalClock()
    for k in range(100):
        for back_s in (0.0, 0.002):
            assert clock.run_time(5.0 + 0.01 * k - back_s, 0.01 * k) <= 0.01 * k + 1e-9
    assert clock.resets == 0
    clock.run_time(5.8, 1.0)
    assert clock.resets == 1
