"""One steady pace of a vehicle's clock: what is kept between exchanges changes no answer."""

from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.vehicles.clocks.steady_pace import SteadyPace, TimesyncExchange

_STEPS = st.tuples(
    st.floats(0.05, 0.4),
    st.sampled_from((1.0, 1.0, 1.0, 1.001, 1.02, 0.5, -0.1)),
    st.floats(0.0, 0.02),
    st.floats(0.0, 0.02),
    st.sampled_from((0.0, 0.0, 0.0, 0.004)),
)
"""Time since the last exchange, pace of the vehicle's clock, latency of both ways, stamps' age."""
_WINDOW_S = 5.0


def _explained(exchanges: list[TimesyncExchange], step_s: float) -> int:
    """Return how many one pace explains, each pair compared anew."""
    for first in range(len(exchanges)):
        kept = exchanges[first:]
        pairs = [
            (old, new)
            for place, old in enumerate(kept)
            for new in kept[place:]
            if new.remote_s > old.remote_s
        ]
        least = max(
            (
                (new.sent_s - step_s - o.received_s) / (new.remote_s - o.remote_s)
                for o, new in pairs
            ),
            default=0.0,
        )
        most = min(
            (
                (new.received_s - o.sent_s + step_s) / (new.remote_s - o.remote_s)
                for o, new in pairs
            ),
            default=0.0,
        )
        if least <= most:
            return len(kept)
    raise AssertionError("one exchange alone is always explained")


@given(st.lists(_STEPS, min_size=1, max_size=40))
def test_the_steady_count_equals_that_of_comparing_each_pair(
    steps: list[tuple[float, ...]],
) -> None:
    pace, exchanges, t_s, remote_s = SteadyPace(), list[TimesyncExchange](), 0.0, 100.0
    for dt_s, rate, there_s, back_s, step_s in steps:
        t_s, remote_s = t_s + dt_s, remote_s + dt_s * rate
        exchanges.append(TimesyncExchange(t_s - there_s, t_s + back_s, round(remote_s * 1e9)))
        while exchanges[-1].sent_s - exchanges[0].sent_s > _WINDOW_S:
            exchanges.pop(0)
        steady = pace.steady(exchanges, step_s)
        assert steady == _explained(exchanges, step_s)
        if steady >= 3:
            del exchanges[: len(exchanges) - steady]
