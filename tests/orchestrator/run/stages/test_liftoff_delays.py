"""Who takes longest to lift gets its takeoff command first; what runs measured is remembered."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.orchestrator.run.stages.liftoff_delays import LiftoffDelays, takeoff_staggers_s


def test_the_slowest_is_commanded_at_once_and_the_others_by_so_much_later() -> None:
    assert takeoff_staggers_s({"real": 2.9, "twin": 1.4}, ["real", "twin"]) == pytest.approx(
        {"real": 0.0, "twin": 1.5}
    )
    assert takeoff_staggers_s({"real": 2.9, "twin": 2.9}, ["real", "twin"]) == {
        "real": 0.0,
        "twin": 0.0,
    }


def test_a_vehicle_that_is_alone_or_commanded_together_waits_for_none() -> None:
    assert takeoff_staggers_s({"real": 1.4, "twin": 9.0}, ["real"]) == {"real": 0.0}
    assert takeoff_staggers_s({}, ["real", "twin"]) == {"real": 0.0, "twin": 0.0}


@given(st.dictionaries(st.sampled_from("abc"), st.floats(0.0, 60.0), min_size=1))
def test_all_lift_together_unless_one_would_be_disarmed_meanwhile(delays: dict[str, float]) -> None:
    waits = takeoff_staggers_s(delays, delays)
    assert min(waits.values()) == 0.0
    assert max(waits.values()) <= 5.0
    lifted = [waits[name] + delays[name] for name in delays if waits[name] < 5.0]
    assert max(lifted) - min(lifted) < 1e-9


def test_one_takeoff_that_was_held_up_teaches_nothing() -> None:
    learned = LiftoffDelays()
    assert learned.of("twin") is None
    for delay_s in (2.0, 2.1, 9.0, 2.2):
        learned.record("twin", delay_s)
    assert learned.of("twin") == pytest.approx(2.15)
    assert learned.of("real") is None
