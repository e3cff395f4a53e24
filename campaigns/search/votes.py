"""Votes: how often flights of a variant failed, and by what; pure."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from campaigns.search.model import FlightOutcome, Standing


@dataclass(frozen=True, slots=True)
class Votes:
    """How many flights proved something, and how many of these failed by the cause."""

    failed: int
    proven: int
    cause: str = ""


def votes_of(outcomes: Iterable[FlightOutcome], *, cause: str = "") -> Votes:
    """Return the votes of flights. cause: only failures by it count; "": by the most frequent."""
    proven = [one for one in outcomes if one.verdict in {"PASS", "FAIL"}]
    causes = Counter(one.cause for one in proven if one.verdict == "FAIL")
    if not cause:
        # Of equally many the first in the alphabet: the order of the flights must not matter.
        cause = min(causes, key=lambda name: (-causes[name], name), default="")
    return Votes(causes[cause], len(proven), cause)


def standing_of(votes: Votes, *, needed: int, due: int) -> Standing:
    """Return whether so many flights confirm a failure. due: how many were to prove something.

    What is missing (INVALID, ERROR) might have failed or passed: it decides nothing.
    """
    if votes.failed >= needed:
        return "confirmed"
    return "undecided" if votes.failed + due - votes.proven >= needed else "refuted"
