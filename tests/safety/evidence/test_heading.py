"""The heading by which an estimate's frame is anchored: one that another source excludes."""

import math
from dataclasses import replace

import pytest

from tests.safety.evidence.test_motion import ESTIMATE, terms
from wil_campaign.safety.evidence.agreement import SourceAccuracy
from wil_campaign.safety.evidence.evidence import Evidence
from wil_campaign.safety.evidence.poses import HeadingAgreement
from wil_campaign.safety.evidence.terms import SignalTerms
from wil_campaign.safety.model.oracle_results import EvidenceResult
from wil_campaign.safety.model.samples import (
    HeadingSample,
    PoseSample,
    ReferenceSample,
    StageSample,
)
from wil_campaign.worlds.frames import Pose

BY_ESTIMATE = replace(terms("pose"), by_estimate=True, limit_s=0.5)


def seen(
    turned_deg: float,
    *,
    source: str = "gyroscopes",
    accuracy_deg: float = 0.0,
    judged: SignalTerms = BY_ESTIMATE,
    at_s: float = 2.0,
    closed: bool = False,
) -> EvidenceResult | None:
    evidence = Evidence([judged])
    evidence.stage(StageSample(1.0, "takeoff"))
    for tick in range(10, 20):
        pose = Pose((tick * 0.01, 0.0, -1.0))
        evidence.pose(PoseSample(tick * 0.1, "real", pose, (0.1, 0.0, 0.0)))
    if closed:
        evidence.stage(StageSample(1.95, "landed"))
    turned_rad, accuracy_rad = math.radians(turned_deg), math.radians(accuracy_deg)
    evidence.heading(HeadingSample(at_s, "real", source, turned_rad, accuracy_rad))
    results = evidence.results()
    assert bool(evidence.events) == any(result.verdict == "INVALID" for result in results)
    return results[0] if results else None


@pytest.mark.parametrize(
    ("turned_deg", "accuracy_deg", "verdict"),
    [
        (14.0, 0.0, "PASS"),
        (14.2, 0.0, "INVALID"),
        (-40.0, 0.0, "INVALID"),
        (32.0, 6.0, "PASS"),
        (40.0, 6.0, "INVALID"),
    ],
)
def test_a_turn_beyond_the_accuracy_of_both_sources_is_invalid(
    turned_deg: float, accuracy_deg: float, verdict: str
) -> None:
    result = seen(turned_deg, accuracy_deg=accuracy_deg)
    assert result is not None
    assert (result.verdict, result.compared_with) == (verdict, ("gyroscopes",))


def test_reason_says_how_far_from_which_source_and_when() -> None:
    result = seen(40.0, source="gps yaw", accuracy_deg=2.0)
    assert result is not None
    assert result.reason == (
        "pose of real from mavlink: its heading is turned by 40.0 deg from where gps yaw had it, "
        "and its frame was anchored by its heading; the limit is 17.3 deg; "
        "1.00 s after the takeoff command"
    )


def test_accuracy_of_the_campaign_counts() -> None:
    poor = replace(BY_ESTIMATE, accuracy=replace(ESTIMATE, attitude_rad=math.radians(6.0)))
    result = seen(40.0, judged=poor)
    assert result is not None
    assert result.verdict == "PASS"


def test_the_heading_of_an_unjudged_vehicle_is_no_evidence() -> None:
    result = seen(90.0, judged=replace(BY_ESTIMATE, by_estimate=False))
    assert result is not None
    assert result.verdict == "PASS"
    result = seen(90.0, closed=True)
    assert result is not None
    assert result.verdict == "PASS"


@pytest.mark.parametrize(("turned_deg", "verdict"), [(10.0, "PASS"), (-20.0, "INVALID")])
def test_heading_is_held_against_motion_capture_and_truth(turned_deg: float, verdict: str) -> None:
    judged = replace(
        BY_ESTIMATE, references={"mocap": SourceAccuracy(0.002, None, math.radians(0.5))}
    )
    evidence = Evidence([judged])
    evidence.stage(StageSample(0.0, "takeoff"))
    for tick in range(50):
        t_s, place = tick * 0.02, (0.01 * tick, 0.0, -1.0)
        other = Pose.of(place[0], 0.0, 1.0, yaw_rad=0.3 * t_s + math.radians(turned_deg))
        mine = Pose.of(place[0], 0.0, 1.0, yaw_rad=0.3 * t_s)
        if tick % 5 == 0:
            evidence.reference(
                ReferenceSample(t_s, "real", "mocap", place, (0.5, 0.0, 0.0), other.q_wxyz)
            )
        evidence.pose(PoseSample(t_s, "real", mine, (0.5, 0.0, 0.0)))
    (result,) = evidence.results()
    assert result.verdict == verdict
    assert ("from where mocap had it" in result.reason) == (verdict == "INVALID")


def test_a_heading_is_compared_though_the_judged_stamps_went_back_since() -> None:
    mocap = SourceAccuracy(0.002, None, math.radians(0.5))
    agreement = HeadingAgreement(SourceAccuracy(1.0, 0.1, math.radians(2.0)), {"mocap": mocap})
    turned = Pose.of(0.0, 0.0, -1.0, yaw_rad=math.radians(40.0)).q_wxyz
    still = (0.0, 0.0, 0.0)
    agreement.reference(ReferenceSample(2.0, "real", "mocap", (0.0, 0.0, -1.0), still, turned))
    pose = Pose((0.0, 0.0, -1.0))
    found = [agreement.pose(PoseSample(t_s, "real", pose, still)) for t_s in (2.0, 1.5, 2.3)]
    assert found[:2] == [None, None]
    assert found[2] is not None
