"""A body that its tracker has in its place, and turned: the vehicle did not turn."""

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from tests.safety.evidence.test_motion import ESTIMATE, terms
from wil_campaign.safety.evidence.agreement import SourceAccuracy
from wil_campaign.safety.evidence.evidence import Evidence
from wil_campaign.safety.model.oracle_results import EvidenceResult
from wil_campaign.safety.model.samples import PoseSample, ReferenceSample, StageSample
from wil_campaign.worlds.frames import Pose, Quat, quat_from_euler

CAPTURED = replace(
    terms("pose"),
    source="mocap",
    by_estimate=False,
    limit_s=0.5,
    accuracy=SourceAccuracy(0.002, None, math.radians(0.5)),
    references={"mavlink": ESTIMATE},
)
Turning = Callable[[float], Quat]


def seen(judged: Turning, other: Turning, *, late_s: float = 0.0) -> EvidenceResult:
    """Return the evidence of 4 s of flight; late_s: by how much the other's stamps are late."""
    evidence = Evidence([CAPTURED])
    evidence.stage(StageSample(0.0, "takeoff"))
    for tick in range(200):
        t_s, place = tick * 0.02, (0.01 * tick, 0.0, -1.0)
        if tick % 5 == 0:
            q_wxyz = other(t_s - late_s)
            evidence.reference(
                ReferenceSample(t_s, "real", "mavlink", place, (0.5, 0.0, 0.0), q_wxyz)
            )
        pose = Pose(place, judged(t_s))
        evidence.pose(PoseSample(t_s, "real", pose, (0.5, 0.0, 0.0)))
    (result,) = evidence.results()
    return result


def yaw(turned_rad: float) -> Quat:
    return quat_from_euler(0.0, 0.0, turned_rad)


@pytest.mark.parametrize(
    "flipped", [yaw(math.pi), yaw(math.pi / 2), quat_from_euler(math.pi, 0.0, 0.0)]
)
@pytest.mark.parametrize("for_s", [0.5, 10.0])
def test_a_body_whose_markers_are_confused_in_flight_is_no_evidence(
    flipped: Quat, for_s: float
) -> None:
    def judged(t_s: float) -> Quat:
        return flipped if 2.0 <= t_s < 2.0 + for_s else yaw(0.0)

    result = seen(judged, lambda _: yaw(0.7))
    assert result.verdict == "INVALID"
    assert "by mavlink by 0 deg; the limit is 20 deg" in result.reason


@pytest.mark.parametrize("late_s", [-0.19, 0.0, 0.19])
def test_a_vehicle_that_turns_quickly_agrees_whatever_the_delay(late_s: float) -> None:
    def turning(t_s: float) -> Quat:
        braking_rad = math.radians(30.0) * math.copysign(t_s > 3.0, math.sin(15.0 * t_s))
        return quat_from_euler(0.0, braking_rad, min(max(0.0, t_s - 1.0), 1.0) * 4.0)

    assert seen(turning, turning, late_s=late_s).verdict == "PASS"


def test_a_heading_of_the_estimate_that_is_corrected_is_no_fault_of_motion_capture() -> None:
    assert seen(lambda _: yaw(0.0), lambda t_s: yaw(math.pi * (t_s > 2.0))).verdict == "PASS"


def test_one_wrong_attitude_is_none() -> None:
    assert seen(lambda t_s: yaw(math.pi * (2.0 <= t_s < 2.1)), lambda _: yaw(0.0)).verdict == "PASS"


@pytest.mark.parametrize(("step_m", "verdict"), [(0.5, "PASS"), (0.8, "INVALID")])
@pytest.mark.parametrize("poses", [1, 100])
def test_a_position_that_leaps_is_found_with_the_leap_itself(
    step_m: float, poses: int, verdict: str
) -> None:
    evidence = Evidence([replace(CAPTURED, references={"mavlink": replace(ESTIMATE)})])
    evidence.stage(StageSample(0.0, "takeoff"))
    found_s: list[float] = []
    for tick in range(60):
        t_s = tick * 0.02
        place = (0.01 * tick, 0.0, -1.0 - 0.0001 * tick)
        if tick % 5 == 0:
            reference = ReferenceSample(t_s, "real", "mavlink", place, (0.5, 0.0, 0.0), yaw(0.0))
            evidence.reference(reference)
        leapt = step_m if 52 <= tick < 52 + poses else 0.0
        pose = Pose((place[0], leapt, place[2]), yaw(0.0))
        evidence.pose(PoseSample(t_s, "real", pose, (0.5, 0.0, 0.0)))
        found_s += [t_s] if evidence.events and not found_s else []
    if verdict == "INVALID":
        assert found_s == [pytest.approx(1.04)]
        assert evidence.events[0].t_s == pytest.approx(1.02), "before what the way there touches"
        assert "mavlink has the vehicle at 0.5 m/s; the limit is 0.61 m" in evidence.events[0].text
    else:
        assert not any("the limit is 0.61 m" in one.text for one in evidence.events)
