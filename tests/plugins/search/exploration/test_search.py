"""Searches over made-up objectives: what is proposed, passed on, confirmed and reduced."""

import itertools
import math
from dataclasses import replace
from typing import Any

import pytest

from tests.plugins.search.exploration.made_up import (
    corner,
    drive,
    fly,
    number,
    plane,
    problem,
    searched,
)
from wil_campaign.plugins.search.exploration import strategies
from wil_campaign.plugins.search.exploration.coverage import space_coverage_of
from wil_campaign.plugins.search.exploration.gap import ModeGap, variants_passed_on
from wil_campaign.plugins.search.exploration.model import FlightBatch, FlightOutcome, SearchVariant
from wil_campaign.plugins.search.exploration.search import (
    EXHAUSTED,
    SPENT,
    Search,
    failure_name,
    most_flights,
)
from wil_campaign.plugins.search.exploration.space import SearchSpace, SpaceParameter, Values
from wil_campaign.plugins.search.exploration.strategies import (
    FixedStrategy,
    StrategyProposal,
    fixed_points,
)
from wil_campaign.plugins.search.exploration.votes import votes_of, votes_standing


def test_tpe_finds_a_corner_confirms_it_and_takes_the_keys_out_that_do_not_matter() -> None:
    given = problem(plane(z=1), budget={"sim": 60}, confirm_most=1, reduce_flights=100)
    findings, batches = searched(given, corner)
    (case,) = findings.confirmed
    assert (case.standing, case.failed, case.proven) == ("confirmed", 5, 5)
    assert case.interval is not None
    assert (round(case.interval.low, 2), case.interval.high) == (0.48, 1.0)
    assert set(case.reduced.values) == {"x", "y"}
    # The boundary is at 0.6 and 0.5: four halvings from 0 come within a sixteenth of it.
    assert 0.6 <= number(case.reduced.values, "x") <= 0.6 + 1 / 16
    assert 0.5 <= number(case.reduced.values, "y") <= 0.5 + 1 / 16
    assert case.is_reduced
    assert findings.ended == SPENT
    assert [batch.number for batch in batches] == list(range(1, len(batches) + 1))
    flown = sum(len(batch.flights) for batch in batches)
    assert flown == sum(cost.flights for cost in findings.costs.values()) <= most_flights(given)


@pytest.mark.parametrize("strategy", ["tpe", "cma-es", "sobol", "random"])
def test_a_search_proposes_the_same_for_a_seed_and_a_number_of_workers(strategy: str) -> None:
    given = problem(plane(), budget={"sim": 16}, reduce_flights=0)
    batches = searched(given, corner, strategy=strategy)[1]
    assert searched(given, corner, strategy=strategy)[1] == batches
    assert searched(given, corner, strategy=strategy, seed=2)[1] != batches


@pytest.mark.parametrize("strategy", ["tpe", "cma-es", "sobol", "grid", "pairwise"])
def test_no_proposal_breaks_a_constraint(strategy: str) -> None:
    space = plane(constraints=("x + y <= -0.9",))
    findings, _ = searched(problem(space, budget={"sim": 20}), corner, strategy=strategy)
    assert findings.tried
    assert all(space.admits(one.variant.values) for one in findings.tried)
    assert not findings.confirmed


def test_pairs_of_levels_stand_together_in_far_fewer_flights_than_the_grid() -> None:
    space = plane(z=1)
    points = list(fixed_points("pairwise", space, 1))
    grid = list(fixed_points("grid", space, 1))
    assert len(grid) == 125
    assert len(points) <= 40
    for one, other in itertools.combinations("xyz", 2):
        pairs = {(point[one], point[other]) for point in points}
        assert pairs == {(point[one], point[other]) for point in grid}


@pytest.mark.parametrize("text", ["x + y <= -0.5", "abs(x - y) >= 1", "x + y + z + w <= -3.4"])
def test_each_pair_of_levels_that_the_constraints_admit_stands_together(text: str) -> None:
    space = plane(z=1, w=1, constraints=(text,))
    points = list(fixed_points("pairwise", space, 1))
    assert all(space.admits(point) for point in points)
    grid = list(space.grid())
    for one, other in itertools.combinations("xyzw", 2):
        pairs = {(point[one], point[other]) for point in points}
        assert pairs == {(point[one], point[other]) for point in grid}
    assert len(points) <= 60
    assert len({tuple(point.values()) for point in points}) == len(points)
    assert points == list(fixed_points("pairwise", space, 1))


def test_pairs_of_a_grid_too_large_to_list_come_from_random_combinations(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    space = plane(z=1, w=1, constraints=("x + y <= 0",))
    whole = {pair for row in space.grid() for pair in itertools.combinations(row.items(), 2)}
    monkeypatch.setattr(strategies, "_MOST_ROWS", 400)
    points = list(fixed_points("pairwise", space, 1))
    found = {pair for point in points for pair in itertools.combinations(point.items(), 2)}
    assert all(space.admits(point) for point in points)
    assert len(found) >= 0.95 * len(whole)
    assert points == list(fixed_points("pairwise", space, 1))


def test_a_finite_space_is_tried_once_and_no_more() -> None:
    choices = SpaceParameter(name="form", keys=("world.form",), choices=("square", "round"))
    counted = SpaceParameter(name="count", keys=("world.count",), low=1, high=3, is_integer=True)
    space = SearchSpace(parameters=(choices, counted))
    for strategy in ("tpe", "random", "grid"):
        findings, _ = searched(
            problem(space, budget={"sim": 50}), lambda *_: 1.0, strategy=strategy
        )
        points = [tuple(one.variant.values.items()) for one in findings.tried]
        assert len(points) == len(set(points)) == 6, strategy
        assert findings.ended == EXHAUSTED


@pytest.mark.parametrize("strategy", ["tpe", "random", "sobol"])
def test_true_is_another_choice_than_1(strategy: Any) -> None:
    """They are equal in Python: the one that came second was never flown, and not missed."""
    mixed = SpaceParameter(name="held", keys=("held",), choices=(1, True, 2))
    given = problem(SearchSpace(parameters=(mixed,)), budget={"sim": 9})
    findings, _ = searched(given, lambda *_: 1.0, strategy=strategy)
    assert {repr(one.variant.values["held"]) for one in findings.tried} == {"1", "True", "2"}
    assert space_coverage_of(given.space, findings.proven_values).share == 1.0


def test_a_grid_too_large_to_list_is_drawn_point_by_point() -> None:
    """Of ten parameters it took 40 s and 3 GB before the first flight, of twelve all memory."""
    parameters = tuple(SpaceParameter(name=f"p{n}", keys=(f"k{n}",)) for n in range(12))
    points = list(itertools.islice(fixed_points("grid", SearchSpace(parameters=parameters), 1), 50))
    assert len({tuple(point.values()) for point in points}) == 50
    assert {value for point in points for value in point.values()} == set(parameters[0].levels)


class Recorded(FixedStrategy):
    """A strategy that notes what it is given."""

    def __init__(self, space: SearchSpace) -> None:
        super().__init__(fixed_points("sobol", space, 1))
        self.given: dict[int, float | None] = {}
        self.asked: list[StrategyProposal] = []

    def ask(self) -> StrategyProposal | None:
        found = super().ask()
        if found is not None:
            self.asked.append(found)
        return found

    def tell(self, number: int, value: float | None) -> None:
        assert number not in self.given
        self.given[number] = value


def test_a_variant_that_is_refused_or_shows_nothing_gives_the_strategy_no_value() -> None:
    space = plane()

    def refuse(variant: SearchVariant) -> str:
        return "starts inside 'gate'" if number(variant.values, "x") < 0.0 else ""

    def answer(values: Values, mode: str, seed: int) -> float | None:
        del mode, seed
        return None if number(values, "y") < 0.0 else 1.0

    strategy = Recorded(space)
    search = Search(problem(space, budget={"sim": 12}, refuse=refuse, at_once=3), strategy)
    batches = drive(search, lambda batch: fly(space, batch, answer))
    flown = [flight.variant.values for batch in batches for flight in batch.flights]
    assert all(number(values, "x") >= 0.0 for values in flown)
    assert len(search.findings.tried) == 12
    assert {why for _, why in search.findings.refused} == {"starts inside 'gate'"}
    assert len(strategy.given) == len(strategy.asked)
    for proposal in strategy.asked:
        x, y = number(proposal.values, "x"), number(proposal.values, "y")
        assert strategy.given[proposal.number] == (1.0 if x >= 0.0 and y >= 0.0 else None)


def test_a_flight_that_came_near_nothing_is_as_good_as_the_best() -> None:
    space = plane()

    def fly_far(batch: FlightBatch) -> list[FlightOutcome]:
        """Above 0 nothing is near, and a margin is unknown; below it is what x says."""
        xs = [number(flight.variant.values, "x") for flight in batch.flights]
        return [FlightOutcome(verdict="PASS", value=None if x > 0.0 else 1.0 + x) for x in xs]

    strategy = Recorded(space)
    search = Search(problem(space, budget={"sim": 12}, at_once=1), strategy)
    drive(search, fly_far)
    best: float | None = None
    for proposal in strategy.asked:
        x = number(proposal.values, "x")
        if x <= 0.0:
            best = 1.0 + x if best is None else max(best, 1.0 + x)
        assert strategy.given[proposal.number] == (best if x > 0.0 else 1.0 + x)
    assert best is not None


def test_a_space_in_which_nothing_can_be_flown_ends_the_search_with_the_reason() -> None:
    given = problem(plane(), refuse=lambda _: "'real' starts 1.00 m outside of the geofence")
    findings, batches = searched(given, corner, strategy="random")
    assert not batches
    assert "cannot be flown" in findings.ended
    assert "outside of the geofence" in findings.ended


def test_a_failure_that_does_not_come_back_under_other_seeds_is_refuted() -> None:
    flown: set[tuple[object, ...]] = set()

    def once(values: Values, mode: str, seed: int) -> float:
        is_first = tuple(values.values()) not in flown
        flown.add(tuple(values.values()))
        return corner(values, mode, seed) if is_first else 1.0

    given = problem(plane(), budget={"sim": 60}, confirm_most=2)
    findings, batches = searched(given, once)
    assert findings.cases
    assert not findings.confirmed
    assert {one.standing for one in findings.cases} == {"refuted"}
    assert "reduce" not in {batch.purpose for batch in batches}


def test_a_failure_that_comes_back_seldom_is_intermittent_and_stays_open() -> None:
    """A system that fails two of five flights is not one whose failures are refuted."""

    def seldom(values: Values, mode: str, seed: int) -> float:
        return corner(values, mode, seed) if seed in {1, 4} else 1.0

    findings, batches = searched(problem(plane(), budget={"sim": 60}, confirm_most=2), seldom)
    assert [(one.standing, one.failed, one.proven) for one in findings.cases] == [
        ("intermittent", 2, 5)
    ] * 2
    assert not findings.confirmed
    assert {one.variant.name for one in findings.cases} <= {
        open_failure.variant.name for open_failure in findings.open_failures
    }
    assert "reduce" not in {batch.purpose for batch in batches}


def test_confirming_flights_have_seeds_of_their_own_and_reducing_ones_the_same() -> None:
    given = problem(plane(), budget={"sim": 60}, confirm_most=1)
    findings, batches = searched(given, corner)
    (case,) = findings.cases
    explored = {
        f.seed_name for batch in batches if batch.purpose == "explore" for f in batch.flights
    }
    seeds = {
        purpose: {
            tuple((f.seed_name, f.repetition) for f in batch.flights)
            for batch in batches
            if batch.purpose == purpose
        }
        for purpose in ("confirm", "reduce")
    }
    name = failure_name(case.variant)
    assert seeds["confirm"] == {tuple((name, repetition) for repetition in range(1, 6))}
    assert seeds["reduce"] == seeds["confirm"]
    assert name not in explored
    assert failure_name(case.reduced) == name


def test_a_smaller_variant_that_fails_by_something_else_is_not_the_same_failure() -> None:
    space = plane()
    given = problem(space, budget={"sim": 60}, confirm_most=1)
    search = Search(given, FixedStrategy(iter([{"x": 1.0, "y": 1.0}])))
    drive(
        search,
        lambda batch: [
            FlightOutcome(verdict="FAIL", value=0.0, cause=_cause(flight.variant.values))
            for flight in batch.flights
        ],
    )
    (case,) = search.findings.confirmed
    assert case.cause == "collision/twin"
    assert case.reduced.values == {"x": 1.0, "y": 1.0}


def _cause(values: Values) -> str:
    return "collision/twin" if values == {"x": 1.0, "y": 1.0} else "time_limit/twin"


def test_values_that_were_proposed_twice_are_confirmed_once() -> None:
    """Of one number TPE proposes each fifth value again, the worst most of all."""
    height = SpaceParameter(name="height", keys=("goal.altitude_m",), low=0.8, high=2.0, own=1.2)
    given = problem(SearchSpace(parameters=(height,)), budget={"sim": 60}, reduce_flights=0)
    for seed in range(4):
        findings, _ = searched(given, lambda values, *_: 1.3 - number(values, "height"), seed=seed)
        found = [number(case.variant.values, "height") for case in findings.confirmed]
        assert len(set(found)) == len(found) == 3, seed


def test_stop_after_confirms_at_once_and_flies_no_more() -> None:
    given = problem(plane(), budget={"sim": 400}, stop_after=1, confirm_most=5, reduce_flights=0)
    findings, batches = searched(given, corner, strategy="random")
    assert len(findings.confirmed) == 1
    assert batches[-1].purpose == "confirm"
    assert len(findings.tried) < 100
    assert "stop_after" in findings.ended


def test_the_dearer_mode_flies_failures_of_the_cheaper_one_and_those_within_the_gap() -> None:
    def shifted(by: float) -> Any:
        def answer(values: Values, mode: str, seed: int) -> float:
            noise = 0.01 * seed if mode == "wil" else 0.0
            return corner(values, mode, seed) - (by if mode == "wil" else 0.0) + noise

        return answer

    given = problem(plane(), budget={"sim": 80, "wil": 60}, seeds=2, reduce_flights=0)
    narrow, _ = searched(given, shifted(0.0), strategy="sobol")
    wide, _ = searched(given, shifted(0.8), strategy="sobol")

    def passed(findings: Any) -> int:
        return sum("wil" in one.outcomes for one in findings.tried)

    # With a gap of nearly nothing the few that fail are passed on; with one of 0.8 far more.
    failing = sum(one.failed("sim") for one in narrow.tried)
    assert failing <= passed(narrow) <= failing + 3
    assert passed(wide) > 2 * passed(narrow)
    (gap,) = wide.gaps
    assert gap.mean == pytest.approx(-0.785)
    assert {one.mode for one in wide.cases} == {"wil"}
    cost = wide.costs["wil", "pass on"]
    assert (cost.flights, cost.flight_s) == (2 * passed(wide), 20.0 * passed(wide))


@pytest.mark.parametrize(
    ("in_wil", "is_open"), [(0.5, False), (None, True)], ids=["all pass there", "all INVALID there"]
)
def test_a_failure_in_the_cheaper_mode_is_open_until_the_dearer_mode_answers(
    in_wil: float | None, is_open: bool
) -> None:
    """Of four failures in sim the budget of wil takes two: the others are never answered."""
    given = problem(plane(), budget={"sim": 4, "wil": 2}, reduce_flights=0)
    found, _ = searched(given, lambda _, mode, __: -0.5 if mode == "sim" else in_wil)
    open_names = {open_failure.variant.name for open_failure in found.open_failures}
    answered = {one.variant.name for one in found.tried if "wil" in one.outcomes}
    assert (len(open_names), len(answered)) == (4 if is_open else 2, 2)
    assert answered.isdisjoint(open_names) != is_open


def test_a_failure_in_sim_is_settled_by_a_pass_far_from_everything_in_wil() -> None:
    far = FlightOutcome(verdict="PASS", value=None)
    hit = FlightOutcome(verdict="FAIL", value=-0.5, cause="collision/twin")
    given = problem(plane(), budget={"sim": 4, "wil": 4}, reduce_flights=0)
    search = Search(given, FixedStrategy(fixed_points("sobol", plane(), 1)))
    drive(search, lambda batch: [hit if batch.mode == "sim" else far for _ in batch.flights])
    assert all("wil" in one.outcomes for one in search.findings.tried)
    assert search.findings.open_failures == ()


def test_a_pass_far_from_everything_is_passed_on_until_the_gap_is_measured() -> None:
    """Without a margin in sim nothing is known of the dearer mode, which may fail."""

    def fly_far(batch: FlightBatch) -> list[FlightOutcome]:
        far = FlightOutcome(verdict="PASS", value=None)
        hit = FlightOutcome(verdict="FAIL", value=-0.5, cause="collision/real")
        return [far if batch.mode == "sim" else hit for _ in batch.flights]

    given = problem(plane(), budget={"sim": 6, "wil": 4}, reduce_flights=0)
    search = Search(given, FixedStrategy(fixed_points("sobol", plane(), 1)))
    drive(search, fly_far)
    assert search.findings.costs["wil", "pass on"].flights == 4
    assert search.findings.confirmed


def test_a_pass_far_from_everything_comes_last_until_the_gap_is_measured() -> None:
    values = [("far", math.inf), ("a", 0.9), ("b", 0.2)]
    assert variants_passed_on(values, ModeGap("sim", "wil"), probes=1, most=10) == ["b", "a", "far"]
    measured = ModeGap("sim", "wil", (-0.1, 0.0, 0.1))
    assert variants_passed_on(values, measured, probes=1, most=10) == ["b"]


@pytest.mark.parametrize("seed", [0, 2, 4, 6])
def test_contacts_do_not_measure_the_gap(seed: int) -> None:
    """A contact is 0 in both modes: such pairs gave a gap near 0, and the budget was left over."""

    def answer(values: Values, mode: str, _: int) -> float:
        height = 0.5 * (number(values, "x") + number(values, "y")) + 0.3
        return max(height - (0.0 if mode == "sim" else 0.15 + 0.02 * number(values, "x")), 0.0)

    given = problem(plane(), budget={"sim": 40, "wil": 40}, at_once=1, reduce_flights=0)
    findings, _ = searched(given, answer, strategy="sobol", seed=seed)
    (gap,) = findings.gaps
    assert gap.mean == pytest.approx(-0.15, abs=0.02)
    left = [one for one in findings.tried if "wil" not in one.outcomes]
    assert left
    assert not [one for one in left if answer(one.variant.values, "wil", 1) <= 0.0]


def test_what_another_oracle_failed_or_contact_is_at_the_floor() -> None:
    outcome = FlightOutcome(verdict="FAIL", value=0.0)
    assert outcome.is_at_floor
    assert not replace(outcome, value=-0.1).is_at_floor
    assert not replace(outcome, verdict="PASS").is_at_floor


def test_the_worst_are_passed_on_until_the_gap_is_measured() -> None:
    values = [("a", 0.9), ("b", -0.1), ("c", 0.2), ("d", 0.5)]
    unmeasured = ModeGap("sim", "wil", (0.1, 0.1))
    assert variants_passed_on(values, unmeasured, probes=1, most=10) == ["b", "c", "d"]
    assert variants_passed_on(values, unmeasured, probes=1, most=2) == ["b", "c"]
    # Mean 0, spread 0.1: Student's t of 2 degrees, 2.92, times 0.1 times sqrt(4/3) is 0.337.
    measured = ModeGap("sim", "wil", (-0.1, 0.0, 0.1))
    assert measured.least_above(0.5) == pytest.approx(0.5 - 0.3372, abs=1e-4)
    assert variants_passed_on(values, measured, probes=1, most=10) == ["b", "c"]


def test_invalid_flights_confirm_nothing_and_refute_nothing() -> None:
    failed = FlightOutcome(verdict="FAIL", value=0.0, cause="reached/twin")
    invalid = FlightOutcome(verdict="INVALID", value=None)
    votes = votes_of([failed, failed, invalid, invalid, invalid])
    assert (votes.failed, votes.proven, votes.cause) == (2, 2, "reached/twin")
    assert votes_standing(votes, needed=3, due=5) == "undecided"
    assert votes_standing(votes, needed=2, due=5) == "confirmed"
    assert votes_standing(votes_of([failed, invalid]), needed=3, due=2) == "intermittent"
    passed = FlightOutcome(verdict="PASS", value=1.0)
    assert votes_standing(votes_of([passed, *[invalid] * 4]), needed=5, due=5) == "undecided"
    assert votes_standing(votes_of([passed] * 3 + [invalid] * 2), needed=3, due=5) == "undecided"
    assert votes_standing(votes_of([passed] * 5), needed=3, due=5) == "refuted"


def test_failures_count_whatever_their_causes_and_the_most_frequent_is_the_first() -> None:
    other = FlightOutcome(verdict="FAIL", value=0.0, cause="time_limit/twin")
    failed = FlightOutcome(verdict="FAIL", value=0.0, cause="reached/twin")
    votes = votes_of([other, failed, failed])
    assert (votes.failed, votes.proven, votes.cause) == (3, 3, "reached/twin")
    assert list(votes.causes.items()) == [("reached/twin", 2), ("time_limit/twin", 1)]
    assert votes_standing(votes, needed=3, due=3) == "confirmed"
    assert votes_of([other, failed]).cause == votes_of([failed, other]).cause == "reached/twin"


def test_a_case_that_fails_as_it_is_loses_every_key() -> None:
    """A single key was never taken out: the failure seemed to be its value's."""
    given = problem(plane(), budget={"sim": 1}, confirm_most=1)
    search = Search(given, FixedStrategy(iter([{"x": 1.0, "y": 1.0}])))
    batches = drive(search, lambda batch: fly(given.space, batch, lambda *_: -1.0))
    (case,) = search.findings.confirmed
    assert case.reduced.values == {}
    assert case.is_reduced
    assert [dict(b.flights[0].variant.values) for b in batches if b.purpose == "reduce"] == [
        {"y": 1.0},
        {},
    ]


def test_a_variant_that_fails_each_time_by_changing_causes_is_confirmed() -> None:
    """It is reduced to what fails as often, and by the most frequent cause as often."""
    changing = ("collision/twin", "reached/twin", "collision/twin", "speed/twin", "reached/twin")

    def fly_changing(batch: FlightBatch) -> list[FlightOutcome]:
        return [
            FlightOutcome(
                verdict="FAIL",
                value=0.0,
                cause=changing[flight.repetition - 1]
                if batch.purpose != "reduce" or flight.variant.values == {"x": 1.0}
                else "reached/twin",
            )
            for flight in batch.flights
        ]

    search = Search(
        problem(plane(), budget={"sim": 1}), FixedStrategy(iter([{"x": 1.0, "y": 1.0}]))
    )
    drive(search, fly_changing)
    (case,) = search.findings.confirmed
    assert (case.cause, case.failed, case.proven) == ("collision/twin", 5, 5)
    assert case.causes_text == "collision/twin 2, reached/twin 2, speed/twin 1"
    assert case.interval is not None
    assert case.interval.high == 1.0
    assert case.reduced.values == {"x": 1.0}
    assert (case.reduced_failed, case.reduced_causes_text) == (5, case.causes_text)
