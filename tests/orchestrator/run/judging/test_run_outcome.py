"""What stands in a result beside its verdict: later events, and what no mixture had in view."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from wil_campaign.orchestrator.run.judging.run_outcome import _unseen, outcome_reason
from wil_campaign.orchestrator.run_results.run_result import later_events_of
from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.safety.model.verdict import DecisiveEvent, RunDecision


def test_a_cut_list_of_events_ends_with_the_first_event_beyond_the_cut() -> None:
    kinds = ["ERROR"] * 49 + ["INVALID"] + ["FAIL"] * 30
    events = tuple(
        DecisiveEvent(2.0 + at, kind, f"event {at}")  # type: ignore[arg-type]  # a kind's name
        for at, kind in enumerate(kinds)
    )
    cut = later_events_of(RunDecision("FAIL", "touched", events))
    assert [one.reason for one in cut[:49]] == [f"event {at}" for at in range(49)]
    assert (cut[49].verdict, cut[49].at_s) == ("INVALID", 51.0)


def mixture(frames_measured: int, in_view: int | None = None, **not_mixed: int) -> Any:
    """Return a combination's result; in_view: of the gate, None where it is not mixed in."""
    shown = {} if in_view is None else {"gate": SimpleNamespace(frames_in_view=in_view)}
    return SimpleNamespace(frames_measured=frames_measured, shown=shown, not_mixed=not_mixed)


@pytest.mark.parametrize(
    ("combinations", "unseen"),
    [
        ([mixture(9, 0)], ("gate",)),
        ([mixture(9, 0, gate=0)], ("gate",)),
        ([mixture(9, 1)], ()),
        ([mixture(9, 0), mixture(7, 3)], ()),
        ([mixture(9, 0), mixture(7, gate=2)], ()),
        ([mixture(0, 0)], ()),
        ([mixture(9, None, tree=0)], ()),
    ],
)
def test_a_named_object_that_no_mixture_had_in_view_is_unseen(
    combinations: list[Any], unseen: tuple[str, ...]
) -> None:
    assert _unseen(tuple(combinations), {"gate"}) == unseen


@pytest.mark.parametrize(
    ("combinations", "unseen"),
    [
        ([mixture(9, 0)], ("gate",)),
        ([mixture(9, 0), mixture(9, 0)], ("gate",)),
        ([mixture(9, 1)], ()),
        ([mixture(9, 0, tree=2)], ()),
        ([mixture(9, 0, tree=0)], ("gate",)),
        ([mixture(0, 0)], ()),
    ],
)
def test_where_nothing_virtual_was_in_view_all_that_had_to_be_shown_is_unseen(
    combinations: list[Any], unseen: tuple[str, ...]
) -> None:
    """The mixtures of the flight were the real images."""
    assert _unseen(tuple(combinations), set()) == unseen


@pytest.mark.parametrize(
    ("at_s", "goal_s", "source", "said"),
    [
        (5.0, None, "guard.fence/real", "up; the autonomy had not begun to fly"),
        (5.0, 9.0, "altitude/real", "up; the autonomy had not begun to fly"),
        (9.5, 9.0, "altitude/real", "up; the autonomy's last note was 'to the gate'"),
        # An autonomy that crashes as it is loaded, or perceives its first image.
        (5.0, None, "autonomy/real", "up; the autonomy's last note was 'to the gate'"),
    ],
)
def test_a_failure_before_the_autonomy_flew_is_not_taken_for_its_own(
    at_s: float, goal_s: float | None, source: str, said: str
) -> None:
    decision = RunDecision("FAIL", "up", (), source, at_s=at_s)
    assert outcome_reason(decision, "to the gate", (), goal_s=goal_s) == said
    of_the_test = RunDecision("ERROR", "lost", (), source, at_s=at_s)
    assert outcome_reason(of_the_test, "to the gate", (), goal_s=goal_s) == "lost"


def test_an_oracle_that_is_at_its_worst_later_is_no_failure_before_the_autonomy_flew() -> None:
    decision = RunDecision("FAIL", "1.2 m at worst", (), "altitude/real", at_s=5.0)
    worst = OracleResult("altitude", "real", True, "FAIL", 1.2, 0.4, "m", -0.8, 9.5)
    assert "not begun" in outcome_reason(decision, "up", (replace(worst, at_s=5.0),), goal_s=9.0)
    assert "last note was 'up'" in outcome_reason(decision, "up", (worst,), goal_s=9.0)
