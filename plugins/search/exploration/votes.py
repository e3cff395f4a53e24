"""Votes: how many flights of a variant failed, and by which causes; pure."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from wil_campaign.plugins.search.exploration.model import FlightOutcome, Standing


@dataclass(frozen=True, slots=True)
class VariantVotes:
    """The number of flights with PASS or FAIL, and how many of these failed.

    causes: the number of failures by cause, the most frequent first.
    """

    failed: int
    proven: int
    causes: Mapping[str, int]

    @property
    def cause(self) -> str:
        """Return the most frequent cause; "" without a failure."""
        return next(iter(self.causes), "")


def votes_of(outcomes: Iterable[FlightOutcome]) -> VariantVotes:
    """Return the votes of flights."""
    proven = [outcome for outcome in outcomes if outcome.verdict in {"PASS", "FAIL"}]
    counts = Counter(
        flight_outcome.cause for flight_outcome in proven if flight_outcome.verdict == "FAIL"
    )
    # On a tie the first in the alphabet, so that the order of the flights does not matter.
    causes = dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))
    return VariantVotes(counts.total(), len(proven), causes)


def votes_standing(votes: VariantVotes, *, needed: int, due: int) -> Standing:
    """Return whether the votes confirm a failure. needed: failures; due: all flights.

    Flights without a result (INVALID, ERROR) might have failed or passed: they decide nothing. A
    failure that came back, though too seldom to be confirmed, is a failure at some rate: it is
    intermittent. Refuted is one that did not come back in any flight, and all have a result.
    """
    unproven = due - votes.proven
    if votes.failed >= needed:
        return "confirmed"
    if votes.failed + unproven >= needed:
        return "undecided"
    if votes.failed:
        return "intermittent"
    return "undecided" if unproven else "refuted"
