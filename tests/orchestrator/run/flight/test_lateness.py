"""A machine that is too busy for the wall clock is named as the cause of an INVALID."""

import pytest

from wil_campaign.orchestrator.run.flight.lateness import MachineLateness, lateness_remedy
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.safety.model.verdict import decide_verdict


def flight(lates: list[tuple[float, float]], kind: str, source: str, at_s: float) -> list[str]:
    """Return the decisive events of a flight whose goal was given at 100 s, the cause first."""
    run_state = RunState(time=lambda: 100.0)
    lateness = MachineLateness(run_state=run_state, remedy=lateness_remedy(virtual=True))
    run_state.enter("goal")
    for due_s, woken_s in lates:
        lateness.note(due_s, woken_s)
    run_state.decide(kind, "t0 skew 0.160 s exceeds 0.1 s", t_s=at_s, source=source)  # type: ignore[arg-type]
    decision = decide_verdict(run_state.decisive, (), end_s=200.0)
    return [decision.reason, *(event.text for event in decision.also)]


def test_an_invalid_that_the_machine_s_lateness_explains_names_the_machine() -> None:
    skew = "t0 skew 0.160 s exceeds 0.1 s"
    cause = "this machine was late by 0.16 s, 3.20 s after the goal"
    remedy = "fly it by --clock virtual, or on a free machine"
    lates = [(103.2, 103.36), (150.0, 151.0)]
    assert flight(lates, "INVALID", "sync/t0", 103.4) == [f"{cause}; {remedy}", skew]


@pytest.mark.parametrize(
    ("late", "kind", "source"),
    [
        ((103.2, 103.24), "INVALID", "sync/t0"),
        ((101.0, 101.5), "INVALID", "sync/t0"),
        ((105.0, 105.5), "INVALID", "sync/t0"),
        ((103.2, 103.4), "FAIL", "collision/real"),
        ((103.2, 103.4), "INVALID", "operator/hold"),
    ],
)
def test_a_verdict_that_lateness_does_not_explain_keeps_its_reason(
    late: tuple[float, float], kind: str, source: str
) -> None:
    assert flight([late], kind, source, 103.4) == ["t0 skew 0.160 s exceeds 0.1 s"]


def test_attached_vehicles_cannot_be_flown_in_virtual_time() -> None:
    assert lateness_remedy(virtual=False) == "fly on a free machine"
