"""Positions beside another source: what the opening of a window forgets, and no other stage."""

from collections.abc import Callable
from typing import Any

import pytest

from wil_campaign.safety.evidence.agreement import SourceAccuracy
from wil_campaign.safety.evidence.evidence import Evidence
from wil_campaign.safety.evidence.terms import SignalTerms
from wil_campaign.safety.model.oracle_results import EvidenceResult
from wil_campaign.safety.model.samples import PoseSample, ReferenceSample, StageSample, StateSample
from wil_campaign.vehicles.autopilots.autopilot import FlightMode
from wil_campaign.worlds.frames import Pose, quat_from_euler

EXACT_MOVES = SourceAccuracy(1.0, 0.02)
"""Of an estimate that may be off, but moves as its vehicle does."""


def judged(north_m: Callable[[float], float], **stages: float) -> EvidenceResult:
    """Return the evidence of 4 s of positions from -2 s on, beside a vehicle that stands."""
    terms = SignalTerms(
        signal="pose",
        vehicle="real",
        source="mavlink",
        limit_s=0.1,
        required=True,
        accuracy=EXACT_MOVES,
        references={"truth": SourceAccuracy(0.0)},
    )
    evidence = Evidence([terms])
    evidence.state(StateSample(-2.0, "real", True, FlightMode.GUIDED, landed=False))
    for tick in range(-100, 100):
        t_s = tick / 50
        for name in [one for one, at_s in stages.items() if at_s == t_s]:
            evidence.stage(StageSample(t_s, name))  # type: ignore[arg-type]  # a stage's name
        position = (north_m(t_s), 0.02 * (tick % 2), -1.0)  # it moves, and freezes nowhere
        evidence.pose(PoseSample(t_s, "real", Pose(position), (0.0, 0.0, 0.0)))
        if tick % 5 == 0:
            still = (0.0, 0.0, 0.0)
            evidence.reference(ReferenceSample(t_s, "real", "truth", (0.0, 0.0, -1.0), still))
    (result,) = evidence.results()
    return result


def test_a_step_before_the_window_is_forgotten_when_it_opens() -> None:
    def placed(t_s: float) -> float:
        return 0.0 if t_s >= -0.1 else 0.4

    result = judged(placed, takeoff=0.0)
    assert (result.verdict, result.reason) == ("PASS", "")


def test_a_step_at_a_later_stage_is_not_forgotten() -> None:
    def stepped(t_s: float) -> float:
        return 0.4 if t_s >= 1.0 else 0.0

    assert judged(stepped, takeoff=0.0).verdict == "INVALID"
    result = judged(stepped, takeoff=0.0, at_height=1.0)
    assert result.verdict == "INVALID"
    assert "it moved 0.40 m" in result.reason


def standing(
    stage: str, *, up_m: float = 0.0, turns: bool = True, reported: bool = True
) -> EvidenceResult:
    """Return the evidence of a simulated vehicle that repeats one place while its estimate errs.

    It has reported to stand at a height of 0, and then reports a takeoff, or a landing. turns: its
    heading changes. The estimate goes 0.8 m away within half a second.
    """
    terms = SignalTerms(
        signal="pose",
        vehicle="real",
        source="simulator",
        limit_s=0.1,
        required=True,
        accuracy=SourceAccuracy(0.0),
        references={"mavlink": SourceAccuracy(5.0)},
        on_grid=True,
    )
    evidence = Evidence([terms])
    evidence.state(StateSample(-1.0, "real", True, FlightMode.GUIDED, landed=reported))
    still = (0.0, 0.0, 0.0)
    evidence.pose(PoseSample(-1.0, "real", Pose((0.0, 0.0, 0.0)), still))
    evidence.state(StateSample(-0.5, "real", True, FlightMode.GUIDED, landed=False))
    for name in ("takeoff", "at_height", "goal", "land"):
        evidence.stage(StageSample(0.0, name))
        if name == stage:
            break
    for tick in range(1, 125):
        t_s = tick / 50
        q_wxyz = quat_from_euler(0.0, 0.0, 1e-4 * t_s if turns else 0.0)
        evidence.pose(PoseSample(t_s, "real", Pose((0.0, 0.0, -up_m), q_wxyz), still))
        place = (0.8 if t_s > 0.5 else 0.0, 0.0, 0.0)
        evidence.reference(ReferenceSample(t_s, "real", "mavlink", place, still))
    (result,) = evidence.results()
    return result


@pytest.mark.parametrize("stage", ["takeoff", "land"])
def test_a_simulated_vehicle_that_stands_while_its_estimate_errs_is_alive(stage: str) -> None:
    """As PX4 1.16 in SIH, which reports its takeoff before and its landing after it stands."""
    assert (standing(stage).verdict, standing(stage).reason) == ("PASS", "")


@pytest.mark.parametrize(
    ("stage", "changes"),
    [("takeoff", {"up_m": 0.4}), ("takeoff", {"reported": False}), ("goal", {})],
)
def test_one_place_in_the_air_is_still_a_fault(stage: str, changes: dict[str, Any]) -> None:
    result = standing(stage, **changes)
    assert result.verdict == "INVALID"
    assert "it repeats one place for 1.50 s, while mavlink moved 0.80 m" in result.reason


def test_a_vehicle_on_the_ground_whose_heading_repeats_too_is_not_alive() -> None:
    assert standing("takeoff", turns=False).verdict == "INVALID"
