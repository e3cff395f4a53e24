"""Flights to the first confirmed failure: TPE beside Sobol and random points, over seeds.

    python -m bench.search made-up --seeds 20
    python -m bench.search gate --seeds 20
    python -m bench.search gate --seeds 3 --flown

`made-up` flies nothing: a corner of six numbers fails, with noise. The others are the shipped
searches in mode sim. Their flights come from a table of flights that were flown (bench/tables, by
bench.search_table): each is one of those of the nearest point, drawn by the seed. With --flown each
is flown, under virtual time; --set vehicles.twin.physics=compiled flies them by the cheaper body.
"""

import argparse
import math
import statistics
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from bench.search_table import flight_seed, load_table, shipped_search, summary
from wil_campaign.campaigns.values.seeds import run_seed
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.workers.run_server import start_run_server
from wil_campaign.orchestrator.cli.progress_display import SilentDisplay
from wil_campaign.plugins.search.engine import BatchEngine
from wil_campaign.plugins.search.exploration.learning_strategies import make_strategy
from wil_campaign.plugins.search.exploration.model import (
    FlightBatch,
    FlightOutcome,
    SearchFindings,
    SearchProblem,
)
from wil_campaign.plugins.search.exploration.search import Search
from wil_campaign.plugins.search.exploration.space import SearchSpace, SpaceParameter
from wil_campaign.plugins.search.search_part import StrategyName
from wil_campaign.plugins.search.search_runner import fly_search

STRATEGIES: tuple[StrategyName, ...] = ("tpe", "sobol", "random")
_INTERRUPTED = 130
NOISE = 0.05
"""Standard deviation of a made-up margin under another seed."""
Find = Callable[[StrategyName, int], SearchFindings]


def made_up(budget: int, jobs: int) -> Find:
    """Return a search for a corner of six numbers that fails: 3 % of two of them."""
    names = "abcdef"
    space = SearchSpace(
        parameters=tuple(
            SpaceParameter(name=name, keys=(name,), own=0.5, low=0.0) for name in names
        )
    )
    problem = SearchProblem(
        space=space,
        budget={"sim": budget},
        refuse=lambda _: "",
        stop_after=1,
        confirm_most=budget,
        reduce_flights=0,
        at_once=jobs,
    )

    def fly(batch: FlightBatch, seed: int) -> list[FlightOutcome]:
        outcomes = []
        for flight in batch.flights:
            drawn = np.random.default_rng(run_seed(seed, flight.seed_name, flight.repetition))
            shares = space.shares(flight.variant.values) or ()
            value = max(0.8 - shares[0], 0.85 - shares[1]) + float(drawn.normal(0.0, NOISE))
            failed = value <= 0.0
            outcomes.append(FlightOutcome(verdict="FAIL" if failed else "PASS", value=value))
        return outcomes

    def find(strategy: StrategyName, seed: int) -> SearchFindings:
        return drive(problem, strategy, seed, lambda batch: fly(batch, seed))

    return find


def drive(
    problem: SearchProblem,
    strategy: StrategyName,
    seed: int,
    fly: Callable[[FlightBatch], list[FlightOutcome]],
) -> SearchFindings:
    """Return what a search finds whose batches are not flown."""
    search = Search(problem, make_strategy(strategy, problem.space, seed))
    steps = search.steps()
    outcomes: list[FlightOutcome] | None = None
    while True:
        try:
            batch = next(steps) if outcomes is None else steps.send(outcomes)
        except StopIteration:
            return search.findings
        outcomes = fly(batch)


def looked_up(name: str, budget: int, jobs: int) -> Find:
    """Return a shipped search whose flights come from the table of flown ones.

    Of these problems no point of the table was refused, so that nothing asks for that again.
    """
    table = load_table(shipped_search(name, seed=0), name)
    print(summary(table))

    def find(strategy: StrategyName, seed: int) -> SearchFindings:
        search = shipped_search(name, seed=seed, sets=_sets(strategy, budget))

        def fly(batch: FlightBatch) -> list[FlightOutcome]:
            return [table.outcome(f.variant.values, flight_seed(seed, f)) for f in batch.flights]

        problem = replace(search.problem(at_once=jobs), refuse=lambda _: "")
        return drive(problem, strategy, seed, fly)

    return find


def flown(name: str, budget: int, jobs: int, sets: tuple[str, ...] = ()) -> Find:
    """Return a shipped search, flown in mode sim until its first confirmed failure.

    sets: what the flights are set to beside, as KEY=VALUE.
    """
    start_run_server()

    def find(strategy: StrategyName, seed: int) -> SearchFindings:
        search = shipped_search(name, seed=seed, sets=(*_sets(strategy, budget), *sets))
        with tempfile.TemporaryDirectory() as folder:
            cleared = ClearedCampaign("virtual", jobs)
            engine = BatchEngine(cleared=cleared, watcher=SilentDisplay())
            options = FlightOptions(out=Path(folder))
            outcome = fly_search(search, options, cleared, engine, lambda _: None)
        if outcome.exit_code == _INTERRUPTED:
            sys.exit(_INTERRUPTED)
        found = outcome.findings
        what = f"{flights_of(found)} flights, {'found' if found.confirmed else 'found none'}"
        print(f"{strategy} seed {seed}: {what}", file=sys.stderr, flush=True)
        return found

    return find


def _sets(strategy: StrategyName, budget: int) -> tuple[str, ...]:
    """Return what a shipped search is set to: until its first confirmed failure."""
    return (
        f"search.strategy={strategy}",
        f"search.budget={{sim: {budget}}}",
        f"search.confirm.most={budget}",
        "search.stop_after=1",
        "search.reduce=0",
    )


def flights_of(findings: SearchFindings) -> int:
    """Return how many flights a search flew."""
    return sum(cost.flights for cost in findings.costs.values())


def row(strategy: str, found: Sequence[SearchFindings]) -> str:
    """Return the figures of a strategy: how often it found one, and in how many flights.

    The median of all seeds takes those that found none for later than any; spread: quartiles of it.
    """
    flights = sorted(flights_of(one) if one.confirmed else math.inf for one in found)
    least, most = (
        flights[0],
        max((flight for flight in flights if flight < math.inf), default=math.inf),
    )
    low, high = (flights[int(share * (len(flights) - 1))] for share in (0.25, 0.75))
    figures = "  ".join(f"{one:>6g}" for one in (statistics.median(flights), low, high))
    confirmed = sum(flight < math.inf for flight in flights)
    return f"{strategy:<8} {confirmed:>3}/{len(found)}  {figures}  {least:g}..{most:g}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("problem", choices=["made-up", "gate", "intruder"])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--budget", type=int, default=60, help="flights that look for a failure")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--flown", action="store_true", help="fly, in place of the table")
    parser.add_argument("--set", action="append", default=[], help="KEY=VALUE of flights that fly")
    parser.add_argument("--strategies", nargs="+", choices=STRATEGIES, default=STRATEGIES)
    given = parser.parse_args()
    if given.problem == "made-up":
        find = made_up(given.budget, given.jobs)
    elif given.flown:
        find = flown(given.problem, given.budget, given.jobs, tuple(given.set))
    else:
        find = looked_up(given.problem, given.budget, given.jobs)
    print("flights to the first confirmed failure, those that confirm it included")
    print("strategy found  median  quartiles       least..most", flush=True)
    found: dict[StrategyName, list[SearchFindings]] = {
        strategy: [] for strategy in given.strategies
    }
    # Seed by seed, so that flights that are cut short compare all the same.
    for seed in range(1, given.seeds + 1):
        for strategy, findings in found.items():
            findings.append(find(strategy, seed))
    for strategy, findings in found.items():
        print(row(strategy, findings))


if __name__ == "__main__":
    main()
