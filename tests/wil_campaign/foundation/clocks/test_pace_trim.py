"""The pace that a simulation is asked for: it keeps another's time, within bounds."""

from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.foundation.clocks.pace_trim import PaceTrim

STEP_S = 0.05


@given(
    nominal=st.floats(1.0, 10.0),
    share=st.lists(st.floats(0.8, 1.05), min_size=1, max_size=4),
    off_s=st.floats(-0.4, 0.4),
)
def test_times_stay_together_whatever_the_other_attains(
    nominal: float, share: list[float], off_s: float
) -> None:
    trim, pace, ahead_s = PaceTrim(nominal=nominal), nominal, off_s
    for step in range(round(40.0 * len(share) / STEP_S)):
        rate = nominal * share[int(step * STEP_S / 40.0)]
        ahead_s += (pace - rate) * STEP_S
        pace = trim.update(wall_s=step * STEP_S, ahead_s=ahead_s, rate=rate) or pace
        assert 0.5 * nominal <= pace <= 1.25 * nominal
    # Smaller differences are not worth a message.
    assert abs(ahead_s) < 0.02 * nominal


def test_an_attained_pace_is_left_alone() -> None:
    trim = PaceTrim(nominal=3.0)
    asked = [trim.update(wall_s=s / 20.0, ahead_s=0.0, rate=3.001) for s in range(400)]
    assert asked == [None] * 400


def test_no_more_than_two_messages_a_second() -> None:
    trim = PaceTrim(nominal=3.0)
    asked = [trim.update(wall_s=s / 20.0, ahead_s=0.0, rate=2.0 + s % 2) for s in range(400)]
    assert sum(one is not None for one in asked) <= 41
