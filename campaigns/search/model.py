"""What a search flies and what came of it; values only."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from campaigns.schema import Mode
from campaigns.search.gap import ModeGap
from campaigns.search.sensed import SensedView
from campaigns.search.space import Space, Values
from campaigns.statistics.proportions import Interval

Purpose = Literal["explore", "pass on", "confirm", "reduce"]
Standing = Literal["confirmed", "refuted", "undecided"]
FlownVerdict = Literal["PASS", "FAIL", "INVALID", "ERROR", "ABORTED"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """A variant of the campaign. name: of its case; values: what it changes, by parameter.

    of: the variant that it was made smaller from; empty for a proposal.
    """

    name: str
    values: Values
    of: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Flight:
    """A flight that a search wants. repetition from 1.

    seed_name: from this, the repetition and the campaign's seed the flight's seed derives.
    """

    variant: Variant
    mode: Mode
    repetition: int
    seed_name: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Batch:
    """Flights of one mode that a search wants at once. number from 1."""

    number: int
    purpose: Purpose
    mode: Mode
    flights: tuple[Flight, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightOutcome:
    """What came of a flight. value: normalised margin, at most 0 where it failed.

    None where it shows nothing: INVALID, ERROR, or an objective without a margin. cause: what
    decided a FAIL, as "reached/real". duration_s: of the flight; wall_s: on this machine. sensed:
    what its sensors had before them; empty where nobody looked.
    """

    verdict: FlownVerdict
    value: float | None
    cause: str = ""
    reason: str = ""
    duration_s: float = 0.0
    wall_s: float = 0.0
    sensed: tuple[SensedView, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchProblem:
    """What a search needs to know. budget: flights that look for failures, by mode, cheapest first.

    confirm_flights, votes: how often a failing variant is flown again, and how many of these must
    fail. confirm_most: how many variants are. reduce_flights: most for each confirmed failure.
    stop_after: so many confirmed failures end it; None: none. at_once: flights that it wants at
    once. refuse: why a variant cannot be flown in these modes, in words; "" where it can.
    """

    space: Space
    budget: Mapping[Mode, int]
    refuse: Callable[[Variant], str]
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
    """A variant with what came of the flights that look for failures, by mode."""

    variant: Variant
    outcomes: Mapping[Mode, tuple[FlightOutcome, ...]] = field(default_factory=dict)

    def value(self, mode: Mode) -> float | None:
        """Return the smallest value in a mode; None where no flight shows one."""
        values = [one.value for one in self.outcomes.get(mode, ()) if one.value is not None]
        return min(values, default=None)

    def failed(self, mode: Mode) -> bool:
        """Return whether a flight of the mode failed."""
        return any(one.verdict == "FAIL" for one in self.outcomes.get(mode, ()))

    def passed(self, mode: Mode) -> bool:
        """Return whether a flight of the mode passed."""
        return any(one.verdict == "PASS" for one in self.outcomes.get(mode, ()))

    def failed_last(self, modes: Sequence[Mode]) -> bool:
        """Return whether a flight failed in the last of these modes that proved anything."""
        proven = [mode for mode in modes if self.value(mode) is not None or self.failed(mode)]
        return bool(proven) and self.failed(proven[-1])

    @property
    def is_proven(self) -> bool:
        """Return whether a flight in any mode proved something: PASS or FAIL."""
        found = itertools.chain.from_iterable(self.outcomes.values())
        return any(one.verdict in {"PASS", "FAIL"} for one in found)

    def cause(self, mode: Mode) -> str:
        """Return what decided the first failure in a mode; "" without one."""
        causes = [one.cause for one in self.outcomes.get(mode, ()) if one.verdict == "FAIL"]
        return causes[0] if causes else ""


@dataclass(frozen=True, slots=True, kw_only=True)
class FailingCase:
    """A variant that failed and was flown again, and the smallest one that it was reduced to.

    failed of proven flights failed by the cause; interval: of the rate at which it fails.
    reduced, reduced_failed, reduced_proven: the same of the smallest; the variant itself where
    nothing smaller fails as often. is_reduced: False where flights for it ran out.
    """

    variant: Variant
    mode: Mode
    standing: Standing
    cause: str
    failed: int
    proven: int
    interval: Interval | None
    reduced: Variant
    reduced_failed: int
    reduced_proven: int
    is_reduced: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """What flights of a mode cost: how many, in seconds of flight and of this machine."""

    flights: int = 0
    flight_s: float = 0.0
    wall_s: float = 0.0

    def plus(self, outcome: FlightOutcome) -> "Cost":
        """Return the cost with a further flight."""
        return Cost(
            flights=self.flights + 1,
            flight_s=self.flight_s + outcome.duration_s,
            wall_s=self.wall_s + outcome.wall_s,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Findings:
    """What a search found. modes: those that it flies, the dearest last. ended: why, in words.

    refused: variants never flown, and why. cases: those flown again. costs: by mode and purpose.
    gaps: between each mode and the next one. flown: what came of each flight, in their order.
    """

    modes: tuple[Mode, ...]
    tried: tuple[TriedVariant, ...]
    refused: tuple[tuple[Variant, str], ...]
    cases: tuple[FailingCase, ...]
    costs: Mapping[tuple[Mode, Purpose], Cost]
    gaps: tuple[ModeGap, ...]
    ended: str
    flown: tuple[FlightOutcome, ...] = ()

    @property
    def open_failures(self) -> tuple[TriedVariant, ...]:
        """Return what failed last, in its dearest proven mode, and is not confirmed or refuted.

        So is what failed in a cheaper mode where the budget, the gap or INVALID flights left
        the dearer one without an answer.
        """
        settled = {one.variant.name for one in self.cases if one.standing != "undecided"}
        return tuple(
            one
            for one in self.tried
            if one.variant.name not in settled and one.failed_last(self.modes)
        )

    @property
    def unproven(self) -> tuple[TriedVariant, ...]:
        """Return the variants of which no flight proved anything: each was INVALID or ERROR."""
        return tuple(one for one in self.tried if not one.is_proven)

    @property
    def is_proven(self) -> bool:
        """Return whether flights of more than half of the variants proved something."""
        return len(self.unproven) * 2 < len(self.tried)

    @property
    def confirmed(self) -> tuple[FailingCase, ...]:
        """Return the failures that were confirmed."""
        return tuple(one for one in self.cases if one.standing == "confirmed")
