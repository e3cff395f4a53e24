"""A velocity that an oracle judges, beside the ground speed of the vehicle's GPS receiver."""

from dataclasses import replace

import pytest

from tests.safety.evidence.test_agreement import TRACES, recorded
from tests.safety.evidence.test_motion import terms
from wil_campaign.safety.evidence.evidence import Evidence
from wil_campaign.safety.model.oracle_results import EvidenceResult
from wil_campaign.safety.model.samples import GroundSpeedSample, PoseSample, StageSample
from wil_campaign.worlds.frames import Pose, Vec3, add, scale

COPTER, PX4 = "arducopter-4.7-guided", "px4-1.18-offboard"


def ground_speeds(name: str) -> list[GroundSpeedSample]:
    """Return GPS_RAW_INT of a real firmware's flight in its simulation, while armed."""
    path = TRACES / f"{name}-ground-speeds.csv"
    rows = [line.split(",") for line in path.read_text("utf-8").splitlines()[1:]]
    cells = ([int(cell) / 1e3 for cell in row] for row in rows)
    return [GroundSpeedSample(t_s, "real", "gps", speed, acc or None) for t_s, speed, acc in cells]


def drifting(poses: list[PoseSample], share: float) -> list[PoseSample]:
    """Return poses of an estimate that takes the vehicle's motion for a share of what it is.

    Its positions are those to which its velocity leads: it does not contradict itself.
    """
    place: Vec3 = (0.0, 0.0, 0.0)
    drifted, last_s = [], poses[0].t_s
    for sample in poses:
        velocity = scale(sample.velocity_ned_m_s, share)
        place, last_s = add(place, scale(velocity, sample.t_s - last_s)), sample.t_s
        drifted.append(sample._replace(pose=Pose(place), velocity_ned_m_s=velocity))
    return drifted


def judged(poses: list[PoseSample], speeds: list[GroundSpeedSample]) -> EvidenceResult:
    evidence = Evidence([replace(terms("velocity"), limit_s=0.5)])
    evidence.stage(StageSample(poses[0].t_s, "takeoff"))
    waiting = list(speeds)
    for sample in poses:
        while waiting and waiting[0].t_s <= sample.t_s:
            evidence.ground_speed(waiting.pop(0))
        evidence.pose(sample)
    (result,) = evidence.results()
    return result


def test_the_velocity_of_the_real_arducopter_is_that_of_its_gps() -> None:
    result = judged(recorded(COPTER), ground_speeds(COPTER))
    assert (result.verdict, result.reason) == ("PASS", "")
    assert result.compared_with == ("gps",)


@pytest.mark.parametrize("name", [COPTER, PX4])
def test_a_receiver_excludes_no_velocity_within_the_accuracy_of_both(name: str) -> None:
    # PX4's receiver states 0.4 m/s: 2 m/s are no contradiction.
    result = judged(drifting(recorded(name), 1.0), ground_speeds(name))
    assert (result.verdict, result.compared_with) == ("PASS", ("gps",))


def test_an_estimate_that_drifts_by_itself_is_found_by_the_receiver() -> None:
    # 2 m/s are flown, and 0.6 m/s are estimated, by velocity and positions alike.
    result = judged(drifting(recorded(COPTER), 0.3), ground_speeds(COPTER))
    assert result.verdict == "INVALID"
    assert "velocity of real from mavlink: by it the vehicle moved 0." in result.reason
    assert "by gps 1." in result.reason
    assert "the limit is 0.71 m/s" in result.reason


def test_a_landing_whose_velocity_is_wrong_is_found_by_a_receiver_that_is_exact() -> None:
    # By its own velocity the real PX4 1.18 went 0.9 m/s aside while it landed.
    exact = [ground_speed._replace(accuracy_m_s=0.05) for ground_speed in ground_speeds(PX4)]
    result = judged(drifting(recorded(PX4), 1.0), exact)
    assert result.verdict == "INVALID"
    assert "by gps 0." in result.reason


def test_speeds_without_poses_around_them_are_not_compared() -> None:
    poses = recorded(COPTER)
    early = [GroundSpeedSample(poses[0].t_s, "real", "gps", 9.0, 0.1)]
    result = judged(poses, early)
    assert (result.verdict, result.compared_with) == ("PASS", ())
