"""What stands in a result of the events after the one that made the verdict."""

from orchestrator.run.judging.run_outcome import also_of
from safety.model.verdict import Decision, DecisiveEvent


def test_what_is_cut_is_told_with_the_first_event_that_is_left_out() -> None:
    kinds = ["ERROR"] * 49 + ["INVALID"] + ["FAIL"] * 30
    events = tuple(
        DecisiveEvent(2.0 + at, kind, f"event {at}")  # type: ignore[arg-type]  # a kind's name
        for at, kind in enumerate(kinds)
    )
    cut = also_of(Decision("FAIL", "touched", events))
    assert [one.reason for one in cut[:49]] == [f"event {at}" for at in range(49)]
    assert (cut[49].verdict, cut[49].at_s) == ("INVALID", 51.0)
