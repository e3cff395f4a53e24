"""Positions beside another source: what the opening of a window forgets, and no other stage."""

from collections.abc import Callable

from safety.evidence.agreement import Accuracy
from safety.evidence.evidence import Evidence
from safety.evidence.terms import SignalTerms
from safety.model.oracle_results import EvidenceResult
from safety.model.samples import PoseSample, ReferenceSample, StageSample, StateSample
from vehicles.autopilots.autopilot import Mode
from worlds.frames import Pose

EXACT_MOVES = Accuracy(1.0, 0.02)
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
        references={"truth": Accuracy(0.0)},
    )
    evidence = Evidence([terms])
    evidence.state(StateSample(-2.0, "real", True, Mode.GUIDED, landed=False))
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
