"""What the guard's events decide, and which of them come with a landing."""

import pytest

from wil_campaign.safety.guard.core.events import (
    EventKind,
    GuardEvent,
    brings_down,
    decisive_guard_event,
)


@pytest.mark.parametrize(
    ("kind", "verdict", "lands"),
    [
        ("fence", "FAIL", True),
        ("lost", "ERROR", True),
        ("abort", "ABORTED", True),
        ("record", "ERROR", False),
        ("bring_down", None, True),
        ("hold", None, False),
        ("alone", None, False),
    ],
)
def test_each_event_of_the_guard_has_its_verdict(
    kind: EventKind, verdict: str | None, *, lands: bool
) -> None:
    event = GuardEvent(1.0, kind, "real", "why")
    decided = decisive_guard_event(event)
    assert (None if decided is None else decided.kind) == verdict
    assert brings_down(event) is lands
