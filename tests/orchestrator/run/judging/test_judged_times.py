"""Which poses are judged, of sources that are even, that jitter, and that are too quick."""

from itertools import accumulate, pairwise

import pytest

from wil_campaign.orchestrator.run.judging.oracle_runner import JudgedTimes


def judged(times_s: list[float]) -> list[float]:
    """Return the times of the poses that are judged."""
    chosen = JudgedTimes()
    return [t_s for t_s in times_s if chosen.is_due(t_s, (0.9 * t_s, 0.0, 0.0))]


@pytest.mark.parametrize(
    "steps_ms", [(20,), (16, 24), (24, 16), (16, 24, 20), (16, 16, 24, 24), (13, 27)]
)
def test_each_pose_of_a_source_of_fifty_a_second(steps_ms: tuple[int, ...]) -> None:
    """A PX4 in SIH steps by 16 and 24 ms: a third of its ground truth was not judged."""
    times_s = list(accumulate(0.001 * steps_ms[i % len(steps_ms)] for i in range(300)))
    assert judged(times_s) == times_s


@pytest.mark.parametrize("rate_hz", [100, 200, 400])
def test_a_quicker_source_is_judged_fifty_times_a_second(rate_hz: int) -> None:
    times_s = [tick / rate_hz for tick in range(rate_hz * 4)]
    chosen = judged(times_s)
    assert len(chosen) == pytest.approx(200, abs=2)
    assert max(b - a for a, b in pairwise(chosen)) < 0.021


def test_a_silence_is_not_made_up_for() -> None:
    times_s = [tick / 100 for tick in range(100)] + [5.0 + tick / 100 for tick in range(100)]
    after = [t_s for t_s in judged(times_s) if t_s >= 5.0]
    assert len(after) == pytest.approx(50, abs=1)


def test_a_pose_that_leaps_is_judged_whenever_it_comes() -> None:
    """At 200 Hz three of four outliers fell between judged poses, and the guard acted on them."""
    for at in range(100, 104):
        chosen = JudgedTimes()
        places = [(1.1 if tick == at else 0.0, 0.0, -1.0) for tick in range(200)]
        taken = [tick for tick in range(200) if chosen.is_due(tick / 200, places[tick])]
        assert at in taken
        assert len(taken) <= 53
