"""The headline of a failed run: what the vehicle did, in one sentence."""

from dataclasses import replace

import pytest

from tests.orchestrator.report.recorded_campaign import passed, touched
from wil_campaign.orchestrator.report.reading.cause import NearestPass, run_success_of
from wil_campaign.orchestrator.report.reading.distances import TimedPose
from wil_campaign.orchestrator.report.reading.headline import headline_of
from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.worlds.frames import Pose

STAGES = {"goal": 10.0, "land": 50.0}


def flown(*norths_m: float) -> list[TimedPose]:
    """Poses a second apart, from the goal on."""
    return [(10.0 + k, Pose.of(north_m, 0.0, 1.0)) for k, north_m in enumerate(norths_m)]


def missed(detail: str = "") -> OracleResult:
    return OracleResult("reached", "real", True, "FAIL", None, 0.5, "m", None, None, detail)


def line_of(oracle: OracleResult, poses: list[TimedPose], passed: NearestPass | None = None) -> str:
    result = replace(touched(), oracles=(oracle,), decided_by=f"{oracle.name}/real")
    return headline_of(result, oracle, poses, stages=STAGES, at_s=None, passed=passed)


def test_a_vehicle_that_never_moved() -> None:
    found = line_of(missed(), flown(*[0.1] * 41))
    assert found == "The real vehicle did not move for 40 s after the goal was given."


def test_a_vehicle_that_stopped_before_its_goal() -> None:
    found = line_of(missed(), flown(0.0, 1.0, 2.0, *[3.0] * 21), NearestPass(30.0, 1.26))
    assert found == (
        "The real vehicle stopped for the last 20 s, and came no nearer to its goal than 1.3 m."
    )


def test_a_place_that_was_just_missed_has_its_tolerance_beside_it() -> None:
    """It came "no nearer than 0.4 m", where 0.4 m had sufficed."""
    near = OracleResult("reached_position", "real", True, "FAIL", 0.402, 0.4, "m", -0.002, None, "")
    found = line_of(near, flown(0, 2, 4), NearestPass(11.0, 0.402))
    assert found == "The real vehicle came no nearer to its goal than 0.402 m (limit 0.4 m)."


def test_a_vehicle_that_flew_past() -> None:
    found = line_of(
        missed("never flew through gate; passed 1.12 m beside it"), flown(0.0, 2.0, 4.0)
    )
    assert found == "The real vehicle missed: it passed 1.12 m beside it."


@pytest.mark.parametrize(
    ("poses", "nearest", "words"),
    [
        (flown(0.0, 2.0, 4.0), NearestPass(11.0, 0.7), "came no nearer to its goal than 0.7 m"),
        ([], None, "did not reach its goal"),
    ],
)
def test_a_vehicle_of_which_less_is_known(
    poses: list[TimedPose], nearest: NearestPass | None, words: str
) -> None:
    assert line_of(missed(), poses, nearest) == f"The real vehicle {words}."


def test_a_clearance_says_the_worst_value_first() -> None:
    oracle = OracleResult(
        "clearance", "twin", True, "FAIL", 0.214, 0.35, "m", -0.136, 17.0, "closest to pillar.box"
    )
    found = headline_of(touched(), oracle, [], stages=STAGES, at_s=16.43)
    assert found == (
        "The twin came within 0.214 m of pillar.box (limit 0.35 m, crossed 6.4 s after the goal "
        "was given)."
    )


def test_a_clearance_that_ended_in_contact_says_touched() -> None:
    oracle = OracleResult(
        "clearance", "real", True, "FAIL", 0.0, 0.05, "m", -0.05, 15.6, "touched wall.surface"
    )
    found = headline_of(touched(), oracle, [], stages=STAGES, at_s=15.5)
    assert found == (
        "The real vehicle touched wall.surface (limit 0.05 m, crossed 5.5 s after the goal was "
        "given)."
    )


def test_a_contact_says_when_and_how_fast() -> None:
    (oracle,) = touched().oracles
    found = headline_of(touched(), oracle, [], stages=STAGES, at_s=14.2, speed_m_s=0.84)
    assert found == (
        "The real vehicle touched gate.left 4.2 s after the goal was given, at 0.8 m/s."
    )


@pytest.mark.parametrize(
    ("reason", "why"),
    [
        ("real cannot stop before the fence's north side, 1.59 m away", "could not stop before"),
        ("real left its fence by 0.2 m", "left its fence by 0.2 m"),
    ],
)
def test_a_takeover_at_the_fence_says_that_the_guard_landed_it(reason: str, why: str) -> None:
    result = replace(touched(), reason=reason, decided_by="guard.fence/real")
    found = headline_of(result, None, [], stages=STAGES, at_s=15.5)
    began = "The real vehicle was landed by the guard 5.5 s after the goal was given: it "
    assert found.startswith(began + why)


def test_other_verdicts_have_their_reason() -> None:
    (oracle,) = touched().oracles
    invalid = replace(touched(), verdict="INVALID")
    assert headline_of(invalid, oracle, [], stages=STAGES, at_s=14.2) == ""


def test_a_pass_says_what_was_tightest() -> None:
    success = run_success_of(passed(), goal_s=2.0)
    assert success is not None
    assert success.sentence == (
        "The required check held. The tightest was collision, with 0.30 m to spare, at +2.00 s, "
        "closest to gate.left."
    )
    (margin,) = success.margins
    assert (margin.name, margin.measured, margin.limit) == ("collision", "0.30 m", "at least 0 m")
    assert run_success_of(touched(), goal_s=2.0) is None
    landed = OracleResult("landed", "real", True, "PASS", None, None, "", None, None)
    both = run_success_of(replace(passed(), oracles=(landed, *passed().oracles)), goal_s=2.0)
    assert both is not None
    assert both.sentence.startswith("All 2 required checks held.")
    assert [each.name for each in both.margins] == ["collision", "landed"], "as many as it says"


def test_a_failure_before_the_autonomy_began_is_not_laid_at_its_door() -> None:
    why = "real is 0.4 m outside; the guard holds; the autonomy had not begun to fly"
    result = replace(touched(), reason=why, decided_by="guard.fence/real", oracles=())
    assert result.bare_reason == "real is 0.4 m outside; the guard holds"
    assert headline_of(result, None, [], stages={"takeoff": 3.0}, at_s=5.0) == (
        "The real vehicle was landed by the guard: it is 0.4 m outside. The autonomy had not begun "
        "to fly."
    )
