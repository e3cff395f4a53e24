"""A machine that is too busy for the wall clock is named as the cause of a red run."""

import asyncio
import time

import pytest

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
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


def test_a_failsafe_for_want_of_the_setpoints_of_a_late_machine_is_no_fail() -> None:
    reasons = flight([(102.0, 103.1)], "FAIL", "guard.failsafe/real", 103.4)
    assert reasons[0].startswith("this machine was late by 1.10 s, 2.00 s after the goal")


def test_what_is_decided_before_the_lateness_is_noted_is_explained_too() -> None:
    run_state = RunState(time=lambda: 100.0)
    lateness = MachineLateness(run_state=run_state, remedy="fly on a free machine")
    run_state.decide("INVALID", "skew", t_s=103.1, source="sync/t0")
    for late in [(102.0, 103.1), (103.2, 103.4)]:
        lateness.note(*late)
    assert [event.source for event in run_state.decisive] == ["sync/t0", "machine/clock"]
    assert decide_verdict(run_state.decisive, (), end_s=200.0).source == "machine/clock"


@pytest.mark.parametrize(
    ("late", "kind", "source"),
    [
        ((103.0, 103.4), "FAIL", "guard.failsafe/real"),
        ((101.0, 102.3), "FAIL", "guard.failsafe/real"),
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


@pytest.mark.parametrize(
    ("late_s", "held", "kind", "source"),
    [
        (1.1, "held up the program", "FAIL", "autonomy/real"),
        (1.1, "", "INVALID", "machine/clock"),
        (0.4, "held up the program", "INVALID", "machine/clock"),
    ],
)
@pytest.mark.parametrize("is_decided_before", [False, True])
def test_an_autonomy_that_held_up_the_program_is_named_and_no_machine(
    late_s: float, held: str, kind: str, source: str, is_decided_before: bool
) -> None:
    """Its regular expression of 38 s was INVALID by "this machine was late"."""
    run_state = RunState(time=lambda: 100.0)
    holding = ("real", held) if held else None
    lateness = MachineLateness(run_state=run_state, remedy="", holding=lambda: holding)

    def decide() -> None:
        run_state.decide("INVALID", "no sample", t_s=102.06, source="evidence/pose/real")

    if is_decided_before:
        decide()
    lateness.note(102.0, 102.0 + late_s)
    if not is_decided_before:
        decide()
    found = decide_verdict(run_state.decisive, (), end_s=200.0)
    assert (found.verdict, found.source, found.at_s) == (kind, source, 102.0)
    if kind == "FAIL":
        assert found.reason == "the autonomy of real held up the program"


def test_attached_vehicles_cannot_be_flown_in_virtual_time() -> None:
    assert lateness_remedy(virtual=False) == "fly on a free machine"


@pytest.mark.parametrize(
    ("flies_on", "asleep_s", "verdict"),
    [(True, 3.0, "INVALID"), (True, 0.0, "PASS"), (False, 3.0, "PASS")],
)
def test_a_machine_that_was_suspended_did_not_see_what_was_flown(
    monkeypatch: pytest.MonkeyPatch, flies_on: bool, asleep_s: float, verdict: str
) -> None:
    """CLOCK_MONOTONIC stands meanwhile (man clock_gettime), and with it all that is measured."""
    clock = {"asleep_s": 50.0}

    def read(which: int) -> float:
        return 100.0 + (clock["asleep_s"] if which == time.CLOCK_BOOTTIME else 0.0)

    monkeypatch.setattr(time, "clock_gettime", read)

    async def fly() -> RunState:
        run_state = RunState(time=asyncio.get_running_loop().time)
        lateness = MachineLateness(run_state=run_state, remedy="", flies_on=flies_on)
        run_state.enter("takeoff")
        task = asyncio.create_task(lateness.run())
        await asyncio.sleep(0.5)
        clock["asleep_s"] += asleep_s
        await asyncio.sleep(0.5)
        task.cancel()
        await asyncio.wait([task])
        return run_state

    found = decide_verdict(run_virtual(fly()).decisive, (), end_s=200.0)
    assert found.verdict == verdict
    assert ("suspended for 3.00 s" in found.reason) is (verdict == "INVALID")
