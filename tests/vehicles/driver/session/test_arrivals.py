"""Arrivals thinned for a reader that is late: no silence comes out longer than it was."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.vehicles.driver.session.arrivals import STEP_S, Arrivals

_GAPS_S = st.lists(st.floats(0.001, 2.0), min_size=1, max_size=60)


def longest_s(times_s: list[float]) -> float:
    return max((b - a for a, b in itertools.pairwise(times_s)), default=0.0)


@given(_GAPS_S, st.integers(1, 60))
def test_silences_are_returned_as_long_as_they_were(gaps_s: list[float], taken_each: int) -> None:
    """Whenever it is read: beyond the step the longest silence is the true one, else none is."""
    arrivals, times_s, returned_s = Arrivals(), [0.0], [0.0]
    arrivals.note(0.0)
    for count, gap_s in enumerate(gaps_s, 1):
        times_s.append(times_s[-1] + gap_s)
        arrivals.note(times_s[-1])
        if count % taken_each == 0:
            returned_s += [t_s for t_s in arrivals.take() if t_s > returned_s[-1]]
    returned_s += [t_s for t_s in arrivals.take() if t_s > returned_s[-1]]
    assert set(returned_s) <= set(times_s)
    assert returned_s[-1] == times_s[-1]
    if longest_s(times_s) > STEP_S:
        assert longest_s(returned_s) == longest_s(times_s)
    else:
        assert longest_s(returned_s) <= STEP_S


def test_nothing_is_returned_twice() -> None:
    arrivals = Arrivals()
    assert arrivals.take() == ()
    for number in range(11):
        arrivals.note(0.05 * number)
    assert arrivals.take() == pytest.approx((0.0, 0.15, 0.2, 0.35, 0.4, 0.5))
    assert arrivals.take() == ()
    arrivals.note(0.55)
    assert arrivals.take() == (0.55,)
