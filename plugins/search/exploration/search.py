"""A search as a generator: it yields batches of flights, and receives their outcomes.

The outcomes alone decide what is yielded next. So an interrupted search is resumed by sending the
outcomes of its ledger again, without flying them.
"""

import math
from collections.abc import Generator, Iterable, Sequence
from dataclasses import replace
from itertools import pairwise

from wil_campaign.campaigns.schema import Mode
from wil_campaign.plugins.search.exploration.gap import ModeGap, variants_passed_on
from wil_campaign.plugins.search.exploration.model import (
    FailingCase,
    FlightBatch,
    FlightCost,
    FlightOutcome,
    Purpose,
    SearchFindings,
    SearchFlightPlan,
    SearchProblem,
    SearchVariant,
    TriedVariant,
)
from wil_campaign.plugins.search.exploration.reduction import reduced_variants, values_without_own
from wil_campaign.plugins.search.exploration.strategies import SearchStrategy, point_key
from wil_campaign.plugins.search.exploration.votes import votes_of, votes_standing
from wil_campaign.plugins.statistics.proportions import clopper_pearson

_Flown = Generator[FlightBatch, Sequence[FlightOutcome], tuple[FlightOutcome, ...]]
Steps = Generator[FlightBatch, Sequence[FlightOutcome], None]

_MOST_REFUSED = 300
"""Number of proposals in a row that cannot be flown after which the search ends."""
SPENT = "the budget is used up"
EXHAUSTED = "every variant was tried"


class Search:
    """A search in progress. findings: the result so far, also of an interrupted search."""

    def __init__(self, problem: SearchProblem, strategy: SearchStrategy) -> None:
        self._problem = problem
        self._strategy = strategy
        self._tried: dict[str, TriedVariant] = {}
        self._refused: list[tuple[SearchVariant, str]] = []
        self._cases: list[FailingCase] = []
        self._costs: dict[tuple[Mode, Purpose], FlightCost] = {}
        self._gaps: list[ModeGap] = []
        self._flown: list[FlightOutcome] = []
        self._batches = 0
        self._ended = ""
        """Why no more variants are proposed; empty while the strategy proposes."""

    def steps(self) -> Steps:
        """Yield the batches to fly: failures are searched in the cheapest mode first."""
        modes = self._problem.modes
        yield from self._explore(modes[0], is_last=len(modes) == 1)
        for lower, upper in pairwise(modes):
            yield from self._pass_on(lower, upper)
        yield from self._confirm_all(modes[-1])

    @property
    def findings(self) -> SearchFindings:
        """Return the result of the search so far."""
        return SearchFindings(
            modes=self._problem.modes,
            tried=tuple(self._tried.values()),
            refused=tuple(self._refused),
            cases=tuple(self._cases),
            costs=dict(self._costs),
            gaps=tuple(self._gaps),
            ended=self._ended,
            flown=tuple(self._flown),
        )

    @property
    def _is_enough(self) -> bool:
        wanted = self._problem.stop_after
        confirmed = sum(failing_case.standing == "confirmed" for failing_case in self._cases)
        return wanted is not None and confirmed >= wanted

    def _left(self, mode: Mode) -> int:
        """Return how many more variants the budget of a mode allows."""
        spent = sum(
            len(tried_variant.outcomes.get(mode, ())) for tried_variant in self._tried.values()
        )
        return (self._problem.budget[mode] - spent) // self._problem.seeds

    def _explore(self, mode: Mode, *, is_last: bool) -> Steps:
        """Fly the strategy's proposals. is_last: failures are confirmed in this mode as well."""
        at_once = max(1, self._problem.at_once // self._problem.seeds)
        self._ended = SPENT
        while left := self._left(mode):
            proposed = self._proposals(min(at_once, left))
            if not proposed:
                return
            yield from self._look([variant for _, variant in proposed], mode, "explore")
            for number, variant in proposed:
                self._strategy.tell(number, self._strategy_value(self._tried[variant.name], mode))
            if is_last and self._problem.stop_after is not None:
                yield from self._confirm_all(mode)
                if self._is_enough:
                    self._ended = f"{self._problem.stop_after} confirmed (stop_after)"
                    return

    def _strategy_value(self, tried: TriedVariant, mode: Mode) -> float | None:
        """Return the value that is reported to the strategy; None where no flight has a result.

        A flight that passed without a margin was near no limit: it counts as the best so far.
        """
        value = tried.value(mode)
        if value is not None or not tried.passed(mode):
            return value
        known = (tried_variant.value(mode) for tried_variant in self._tried.values())
        return max((one for one in known if one is not None), default=None)

    def _proposals(self, count: int) -> list[tuple[int, SearchVariant]]:
        """Return proposals that can be flown, by number; empty when the strategy has no more."""
        found: list[tuple[int, SearchVariant]] = []
        refused_in_a_row = 0
        while len(found) < count:
            proposal = self._strategy.ask()
            if proposal is None:
                self._ended = EXHAUSTED
                break
            number = len(self._tried) + len(self._refused) + len(found) + 1
            variant = SearchVariant(name=f"v{number:04d}", values=proposal.values)
            why = self._problem.refuse(variant)
            if not why:
                found.append((proposal.number, variant))
                refused_in_a_row = 0
                continue
            self._refused.append((variant, why))
            self._strategy.tell(proposal.number, None)
            refused_in_a_row += 1
            if refused_in_a_row >= _MOST_REFUSED:
                self._ended = f"{_MOST_REFUSED} variants in a row cannot be flown; the last: {why}"
                break
        return found

    def _pass_on(self, lower: Mode, upper: Mode) -> Steps:
        """Fly in the costlier mode what failed in the cheaper one, or may fail by the gap."""
        while left := self._left(upper):
            gap = self._gap(lower, upper)
            waiting = [
                (name, value)
                for name, tried_variant in self._tried.items()
                if upper not in tried_variant.outcomes
                and (value := _rank_of(tried_variant, lower)) is not None
            ]
            most = min(left, max(1, self._problem.at_once // self._problem.seeds))
            chosen = variants_passed_on(
                waiting, gap, probes=most, most=left if not gap.is_measured else most
            )
            if not chosen:
                break
            yield from self._look([self._tried[name].variant for name in chosen], upper, "pass on")
        self._gaps.append(self._gap(lower, upper))

    def _gap(self, lower: Mode, upper: Mode) -> ModeGap:
        """Return the gap of all variants that were flown in both modes, paired by seed.

        Without pairs of which one is at the floor: their difference would be too near to 0.
        """
        pairs = [
            (low.value, high.value)
            for tried_variant in self._tried.values()
            for low, high in zip(
                tried_variant.outcomes.get(lower, ()),
                tried_variant.outcomes.get(upper, ()),
                strict=False,
            )
            if not (low.is_at_floor or high.is_at_floor)
        ]
        differences = (high - low for low, high in pairs if low is not None and high is not None)
        return ModeGap(lower, upper, tuple(differences))

    def _look(self, variants: Sequence[SearchVariant], mode: Mode, purpose: Purpose) -> Steps:
        """Fly variants under their own seeds, and store the outcomes."""
        repetitions = range(1, self._problem.seeds + 1)
        flights = [
            SearchFlightPlan(variant=one, mode=mode, repetition=repetition, seed_name=one.name)
            for one in variants
            for repetition in repetitions
        ]
        outcomes = yield from self._fly(flights, mode, purpose)
        for index, variant in enumerate(variants):
            own = outcomes[index * len(repetitions) : (index + 1) * len(repetitions)]
            before = self._tried.get(variant.name, TriedVariant(variant=variant))
            by_mode = {**before.outcomes, mode: own}
            self._tried[variant.name] = replace(before, outcomes=by_mode)

    def _confirm_all(self, mode: Mode) -> Steps:
        """Fly failing variants again, up to the limit: new causes first, then the worst.

        Values that are confirmed already are not, though a strategy may propose them twice.
        """
        while len(self._cases) < self._problem.confirm_most and not self._is_enough:
            done = {failing_case.variant.name for failing_case in self._cases}
            causes = {failing_case.cause for failing_case in self._cases}
            known = {
                point_key(failing_case.variant.values)
                for failing_case in self._cases
                if failing_case.standing == "confirmed"
            }
            failing = [
                tried_variant
                for tried_variant in self._tried.values()
                if tried_variant.failed(mode)
                and tried_variant.variant.name not in done
                and point_key(tried_variant.variant.values) not in known
            ]
            if not failing:
                return
            chosen = min(
                failing, key=lambda one: (one.cause(mode) in causes, one.value(mode) or 0.0)
            )
            yield from self._confirm(chosen, mode)

    def _confirm(self, tried: TriedVariant, mode: Mode) -> Steps:
        """Fly one failing variant again, and reduce it where it fails often enough."""
        variant = tried.variant
        outcomes = yield from self._vote(variant, variant, mode, "confirm")
        votes = votes_of(outcomes)
        standing = votes_standing(votes, needed=self._problem.votes, due=len(outcomes))
        # Without a further failure the first one gives the cause.
        cause = votes.cause or tried.cause(mode)
        found = FailingCase(
            variant=variant,
            mode=mode,
            standing=standing,
            cause=cause,
            failed=votes.failed,
            proven=votes.proven,
            interval=clopper_pearson(votes.failed, votes.proven),
            reduced=variant,
            reduced_failed=votes.failed,
            reduced_proven=votes.proven,
            causes=votes.causes,
            reduced_causes=votes.causes,
        )
        if standing == "confirmed":
            found = yield from self._reduce(found)
        self._cases.append(found)

    def _reduce(
        self, found: FailingCase
    ) -> Generator[FlightBatch, Sequence[FlightOutcome], FailingCase]:
        """Make a confirmed case smaller, under the seeds and votes that confirmed it.

        A smaller variant must fail as often, and by the case's cause as often as that confirmed it.
        """
        space, variant = self._problem.space, found.variant
        values = values_without_own(space, variant.values)
        smallest = replace(
            found, reduced=SearchVariant(name=variant.name, values=values, of=variant.name)
        )
        left, needed = self._problem.reduce_flights, self._problem.votes
        by_cause = min(needed, found.causes.get(found.cause, 0))
        attempts = reduced_variants(space, values)
        fails: bool | None = None
        number = 0
        while True:
            try:
                smaller = next(attempts) if fails is None else attempts.send(fails)
            except StopIteration:
                return smallest
            number += 1
            name = f"{variant.name}-r{number:02d}"
            one = SearchVariant(name=name, values=smaller, of=variant.name)
            fails = False
            if self._problem.refuse(one):
                continue
            if left < self._problem.confirm_flights:
                return replace(smallest, is_reduced=False)
            left -= self._problem.confirm_flights
            outcomes = yield from self._vote(one, variant, found.mode, "reduce")
            votes = votes_of(outcomes)
            if votes.failed >= needed and votes.causes.get(found.cause, 0) >= by_cause:
                fails = True
                smallest = replace(
                    smallest,
                    reduced=one,
                    reduced_failed=votes.failed,
                    reduced_proven=votes.proven,
                    reduced_causes=votes.causes,
                )

    def _vote(
        self, variant: SearchVariant, seeded_by: SearchVariant, mode: Mode, purpose: Purpose
    ) -> _Flown:
        """Fly a variant under the seeds that confirm a failure of `seeded_by`."""
        seed_name = failure_name(seeded_by)
        flights = [
            SearchFlightPlan(variant=variant, mode=mode, repetition=repetition, seed_name=seed_name)
            for repetition in range(1, self._problem.confirm_flights + 1)
        ]
        return (yield from self._fly(flights, mode, purpose))

    def _fly(self, flights: Iterable[SearchFlightPlan], mode: Mode, purpose: Purpose) -> _Flown:
        """Yield a batch of flights, and add up the cost of its outcomes."""
        self._batches += 1
        batch = FlightBatch(
            number=self._batches, purpose=purpose, mode=mode, flights=tuple(flights)
        )
        outcomes = tuple((yield batch))
        if len(outcomes) != len(batch.flights):
            raise ValueError(f"{len(outcomes)} outcomes of {len(batch.flights)} flights")
        self._flown += outcomes
        for outcome in outcomes:
            cost = self._costs.get((mode, purpose), FlightCost())
            self._costs[mode, purpose] = cost.plus(outcome)
        return outcomes


def _rank_of(tried: TriedVariant, mode: Mode) -> float | None:
    """Return the value by which a variant is passed on to a costlier mode; None where unproven.

    Infinite where it passed without a margin: it flies there only to measure the gap.
    """
    value = tried.value(mode)
    return math.inf if value is None and tried.passed(mode) else value


def failure_name(variant: SearchVariant) -> str:
    """Return the name of a failing variant's case in a campaign file of its own.

    The seeds of its confirmation derive from it, so that the file's runs have the same ones.
    """
    return f"failure-{variant.of or variant.name}"


def most_flights(problem: SearchProblem) -> int:
    """Return the largest number of flights of a search."""
    again = problem.confirm_flights + problem.reduce_flights
    return sum(problem.budget.values()) + problem.confirm_most * again
