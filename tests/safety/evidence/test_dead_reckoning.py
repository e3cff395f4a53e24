"""A pose by an estimate that nothing holds any more: INVALID, or a caveat where it is permitted."""

from dataclasses import replace

import pytest

from tests.safety.evidence.test_motion import terms
from wil_campaign.safety.evidence.evidence import Evidence
from wil_campaign.safety.evidence.terms import SignalTerms
from wil_campaign.safety.model.oracle_results import EvidenceResult
from wil_campaign.safety.model.samples import PoseSample, StageSample, StateSample
from wil_campaign.vehicles.autopilots.autopilot import FlightMode
from wil_campaign.worlds.frames import Pose

LOST = "the estimator has lost its absolute position (POS_HORIZ_ABS)"
BY_ESTIMATE = replace(terms("pose"), by_estimate=True, limit_s=0.5, references={})
PERMITTED = replace(BY_ESTIMATE, permits_dead_reckoning=True)


def judged(signal: SignalTerms, *, lost_s: float | None, found_s: float = 9.0) -> EvidenceResult:
    evidence = Evidence([signal])
    evidence.stage(StageSample(0.0, "takeoff"))
    for tick in range(50):
        t_s = tick / 10
        lost = LOST if lost_s is not None and lost_s <= t_s < found_s else None
        state = StateSample(t_s, "real", True, FlightMode.GUIDED, landed=False, dead_reckoning=lost)
        evidence.state(state)
        evidence.pose(PoseSample(t_s, "real", Pose((t_s / 10, 0.0, -1.0)), (0.1, 0.0, 0.0)))
        if tick == 40:
            evidence.stage(StageSample(t_s, "landed"))
    (result,) = evidence.results()
    assert [event.kind for event in evidence.events] == ["INVALID"] * (result.verdict == "INVALID")
    assert all(event.t_s == lost_s for event in evidence.events)
    return result


@pytest.mark.parametrize("found_s", [2.1, 9.0])
def test_loss_is_invalid_from_its_time_on_also_when_it_is_found_again(found_s: float) -> None:
    result = judged(BY_ESTIMATE, lost_s=2.0, found_s=found_s)
    assert result.verdict == "INVALID"
    assert result.reason == (
        f"pose of real from mavlink: {LOST}: dead reckoning from then on; "
        "2.00 s after the takeoff command"
    )
    assert result.caveat == ""


def test_loss_that_is_permitted_is_a_caveat() -> None:
    result = judged(PERMITTED, lost_s=2.0)
    assert (result.verdict, result.reason) == ("PASS", "")
    assert result.caveat == LOST


@pytest.mark.parametrize("signal", [BY_ESTIMATE, PERMITTED])
def test_nothing_lost_and_nothing_after_the_landing(signal: SignalTerms) -> None:
    for lost_s in (None, 4.5):
        result = judged(signal, lost_s=lost_s)
        assert (result.verdict, result.reason, result.caveat) == ("PASS", "", "")


def test_another_source_than_the_estimate_stands() -> None:
    result = judged(replace(BY_ESTIMATE, by_estimate=False), lost_s=2.0)
    assert (result.verdict, result.caveat) == ("PASS", "")
