"""Values of a search: variants, flights, outcomes, failing cases and findings."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from wil_campaign.campaigns.schema import Mode
from wil_campaign.plugins.search.exploration.gap import ModeGap
from wil_campaign.plugins.search.exploration.sensed import SensedView
from wil_campaign.plugins.search.exploration.space import SearchSpace, Values
from wil_campaign.plugins.statistics.proportions import RateInterval

Purpose = Literal["explore", "pass on", "confirm", "reduce"]
Standing = Literal["confirmed", "intermittent", "refuted", "undecided"]
_SETTLED: frozenset[Standing] = frozenset({"confirmed", "refuted"})
FlownVerdict = Literal["PASS", "FAIL", "INVALID", "ERROR", "ABORTED"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchVariant:
    """A variant of the campaign. name: of its case; values: what it changes, by parameter.

    of: the variant from which it was reduced; empty for a proposal.
    """

    name: str
    values: Values
    of: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchFlightPlan:
    """A flight that a search requests. repetition from 1.

    seed_name: the flight's seed derives from it, the repetition and the campaign's seed.
    """

    variant: SearchVariant
    mode: Mode
    repetition: int
    seed_name: str


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightBatch:
    """Flights of one mode that a search requests at once. number from 1."""

    number: int
    purpose: Purpose
    mode: Mode
    flights: tuple[SearchFlightPlan, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightOutcome:
    """The outcome of a flight. value: normalised margin, at most 0 where it failed.

    None where there is none: INVALID, ERROR, or an objective without a margin. cause: the oracle
    that decided a FAIL, such as "reached/real". duration_s: of the flight; wall_s: on this machine.
    sensed: what was in view of its sensors; empty where that was not determined.
    """

    verdict: FlownVerdict
    value: float | None
    cause: str = ""
    reason: str = ""
    duration_s: float = 0.0
    wall_s: float = 0.0
    sensed: tuple[SensedView, ...] = ()

    @property
    def is_at_floor(self) -> bool:
        """Return whether a failure has the value 0, from which nothing says how bad it was.

        A contact is 0 however hard it was, and so is what another oracle than the objective failed.
        """
        return self.verdict == "FAIL" and self.value == 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchProblem:
    """The task of a search. budget: flights that look for failures, by mode, cheapest first.

    confirm_flights, votes: how often a failing variant is flown again, and how many of these must
    fail. confirm_most: most variants that are flown again. reduce_flights: most for each confirmed
    failure. stop_after: number of confirmed failures that end the search; None: no limit. at_once:
    flights requested at once. refuse: returns why a variant cannot be flown; "" where it can.
    """

    space: SearchSpace
    budget: Mapping[Mode, int]
    refuse: Callable[[SearchVariant], str]
    seeds: int = 1
    confirm_flights: int = 5
    votes: int = 3
    confirm_most: int = 3
    reduce_flights: int = 40
    stop_after: int | None = None
    at_once: int = 1

    @property
    def modes(self) -> tuple[Mode, ...]:
        """Return the modes in the order of their cost."""
        return tuple(self.budget)


@dataclass(frozen=True, slots=True, kw_only=True)
class TriedVariant:
    """A variant with the outcomes of its flights that look for failures, by mode."""

    variant: SearchVariant
    outcomes: Mapping[Mode, tuple[FlightOutcome, ...]] = field(default_factory=dict)

    def value(self, mode: Mode) -> float | None:
        """Return the smallest value in a mode; None where no flight has one."""
        values = [
            flight_outcome.value
            for flight_outcome in self.outcomes.get(mode, ())
            if flight_outcome.value is not None
        ]
        return min(values, default=None)

    def failed(self, mode: Mode) -> bool:
        """Return whether a flight of the mode failed."""
        return any(
            flight_outcome.verdict == "FAIL" for flight_outcome in self.outcomes.get(mode, ())
        )

    def passed(self, mode: Mode) -> bool:
        """Return whether a flight of the mode passed."""
        return any(
            flight_outcome.verdict == "PASS" for flight_outcome in self.outcomes.get(mode, ())
        )

    def failed_last(self, modes: Sequence[Mode]) -> bool:
        """Return whether a flight failed in the last of these modes with a PASS or a FAIL."""
        proven = [mode for mode in modes if self.failed(mode) or self.passed(mode)]
        return bool(proven) and self.failed(proven[-1])

    def cause(self, mode: Mode) -> str:
        """Return the cause of the first failure in a mode; "" without one."""
        causes = [
            flight_outcome.cause
            for flight_outcome in self.outcomes.get(mode, ())
            if flight_outcome.verdict == "FAIL"
        ]
        return causes[0] if causes else ""


@dataclass(frozen=True, slots=True, kw_only=True)
class FailingCase:
    """A variant that failed and was flown again, and the smallest one that it was reduced to.

    failed of proven flights failed, whatever the cause; interval: of the rate at which it fails.
    cause: the most frequent one; causes: the number of failures by cause, the most frequent first.
    reduced, reduced_failed, reduced_proven, reduced_causes: the same of the smallest; the variant
    itself where nothing smaller fails as often. is_reduced: False where the flights for it were
    used up.
    """

    variant: SearchVariant
    mode: Mode
    standing: Standing
    cause: str
    failed: int
    proven: int
    interval: RateInterval | None
    reduced: SearchVariant
    reduced_failed: int
    reduced_proven: int
    causes: Mapping[str, int] = field(default_factory=dict)
    reduced_causes: Mapping[str, int] = field(default_factory=dict)
    is_reduced: bool = True

    @property
    def causes_text(self) -> str:
        """Return the causes, with the number of failures by each where there are several."""
        return _causes_text(self.causes) or self.cause

    @property
    def reduced_causes_text(self) -> str:
        """Return the causes by which the smallest variant failed."""
        return _causes_text(self.reduced_causes) or self.cause


def _causes_text(causes: Mapping[str, int]) -> str:
    """Return causes as text: "reached/real", or "collision/real 2, reached/real 1"."""
    if len(causes) == 1:
        return next(iter(causes))
    return ", ".join(f"{cause} {count}" for cause, count in causes.items())


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightCost:
    """The cost of flights of a mode: their number, seconds of flight, and of wall time."""

    flights: int = 0
    flight_s: float = 0.0
    wall_s: float = 0.0

    def plus(self, outcome: FlightOutcome) -> "FlightCost":
        """Return the cost with a further flight."""
        return FlightCost(
            flights=self.flights + 1,
            flight_s=self.flight_s + outcome.duration_s,
            wall_s=self.wall_s + outcome.wall_s,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchFindings:
    """The result of a search. modes: those that it flies, the costliest last. ended: why, in words.

    refused: variants never flown, and why. cases: those flown again. costs: by mode and purpose.
    gaps: between each mode and the next one. flown: the outcome of each flight, in their order.
    """

    modes: tuple[Mode, ...]
    tried: tuple[TriedVariant, ...]
    refused: tuple[tuple[SearchVariant, str], ...]
    cases: tuple[FailingCase, ...]
    costs: Mapping[tuple[Mode, Purpose], FlightCost]
    gaps: tuple[ModeGap, ...]
    ended: str
    flown: tuple[FlightOutcome, ...] = ()

    @property
    def open_failures(self) -> tuple[TriedVariant, ...]:
        """Return the variants that failed in their costliest proven mode and are not settled.

        Settled is confirmed or refuted; what came back too seldom is not. A variant that failed in
        a cheaper mode is open as well where the budget, the gap or INVALID flights left the
        costlier mode without a result.
        """
        settled = {
            failing_case.variant.name
            for failing_case in self.cases
            if failing_case.standing in _SETTLED
        }
        return tuple(
            tried_variant
            for tried_variant in self.tried
            if tried_variant.variant.name not in settled and tried_variant.failed_last(self.modes)
        )

    @property
    def proven_values(self) -> tuple[Values, ...]:
        """Return the values of the variants that have a PASS or a FAIL: what covers the space."""
        return tuple(
            one.variant.values
            for one in self.tried
            if any(one.passed(mode) or one.failed(mode) for mode in one.outcomes)
        )

    def flown_in(self, mode: Mode) -> tuple[TriedVariant, ...]:
        """Return the variants that were flown in a mode."""
        return tuple(one for one in self.tried if mode in one.outcomes)

    def unproven_in(self, mode: Mode) -> tuple[TriedVariant, ...]:
        """Return the variants all of whose flights in a mode were INVALID or ERROR."""
        return tuple(
            tried_variant
            for tried_variant in self.flown_in(mode)
            if not (tried_variant.failed(mode) or tried_variant.passed(mode))
        )

    @property
    def is_proven(self) -> bool:
        """Return whether in each mode more than half of its variants have a PASS or a FAIL."""
        return all(
            2 * len(self.unproven_in(mode)) < len(flown)
            for mode in self.modes
            if (flown := self.flown_in(mode))
        )

    def doubtful(self, gap: ModeGap) -> tuple[TriedVariant, ...]:
        """Return the variants that may fail in the costlier mode of a gap and were not flown there.

        Without those that failed in the cheaper one, which are open failures. Where too few pairs
        measure the gap, each of them may.
        """
        return tuple(
            tried_variant
            for tried_variant in self.tried
            if gap.upper not in tried_variant.outcomes
            and not tried_variant.failed(gap.lower)
            and (value := tried_variant.value(gap.lower)) is not None
            and gap.least_above(value) <= 0.0
        )

    @property
    def confirmed(self) -> tuple[FailingCase, ...]:
        """Return the failures that were confirmed."""
        return tuple(
            failing_case for failing_case in self.cases if failing_case.standing == "confirmed"
        )
