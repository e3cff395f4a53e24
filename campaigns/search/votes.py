"""Votes: how many flights of a variant failed, and by which cause; pure."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from campaigns.search.model import FlightOutcome, Standing


@dataclass(frozen=True, slots=True)
class Votes:
    """The number of flights with PASS or FAIL, and how many of these failed by the cause."""

    failed: int
    proven: int
    cause: str = ""


def votes_of(outcomes: Iterable[FlightOutcome], *, cause: str = "") -> Votes:
    """Return the votes of flights. cause: only failures by it count; "": by the most frequent."""
    proven = [one for one in outcomes if one.verdict in {"PASS", "FAIL"}]
    causes = Counter(one.cause for one in proven if one.verdict == "FAIL")
    if not cause:
        # On a tie the first in the alphabet, so that the order of the flights does not matter.
        cause = min(causes, key=lambda name: (-causes[name], name), default="")
    return Votes(causes[cause], len(proven), cause)


def standing_of(votes: Votes, *, needed: int, due: int) -> Standing:
    """Return whether the votes confirm a failure. needed: failures; due: all flights.

    Flights without a result (INVALID, ERROR) might have failed or passed: they decide nothing.
    """
    if votes.failed >= needed:
        return "confirmed"
    return "undecided" if votes.failed + due - votes.proven >= needed else "refuted"
