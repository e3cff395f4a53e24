"""Flights to the first confirmed failure: TPE beside Sobol and random points, over seeds.

    python -m bench.search made-up --seeds 20
    python -m bench.search gate --seeds 5 --budget 30 --jobs 2
    python -m bench.search intruder --seeds 5

`made-up` flies nothing: a corner of six numbers fails, with noise, so that it takes seconds. The
others fly the shipped searches in mode sim, under virtual time.
"""

import argparse
import statistics
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from campaigns.expansion.expansion import Options
from campaigns.schema.search import StrategyName
from campaigns.search.learning_strategies import make_strategy
from campaigns.search.model import Batch, Findings, FlightOutcome, SearchProblem
from campaigns.search.search import Search
from campaigns.search.search_file import load_search
from campaigns.search.space import Parameter, Space
from campaigns.values.seeds import run_seed
from orchestrator.campaign.workers.run_server import start_run_server
from orchestrator.cli.progress_display import SilentDisplay
from orchestrator.search.engine import BatchEngine
from orchestrator.search.search_runner import SearchSettings, fly_search

STRATEGIES: tuple[StrategyName, ...] = ("tpe", "sobol", "random")
CAMPAIGNS = Path(__file__).parents[1] / "campaigns"
NOISE = 0.05
"""Standard deviation of a made-up margin under another seed."""
Find = Callable[[StrategyName, int], Findings]


def made_up(budget: int, jobs: int) -> Find:
    """Return a search for a corner of six numbers that fails: 3 % of two of them."""
    names = "abcdef"
    space = Space(
        parameters=tuple(Parameter(name=one, keys=(one,), own=0.5, low=0.0) for one in names)
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

    def fly(batch: Batch, seed: int) -> list[FlightOutcome]:
        outcomes = []
        for flight in batch.flights:
            drawn = np.random.default_rng(run_seed(seed, flight.seed_name, flight.repetition))
            shares = space.shares(flight.variant.values) or ()
            value = max(0.8 - shares[0], 0.85 - shares[1]) + float(drawn.normal(0.0, NOISE))
            failed = value <= 0.0
            outcomes.append(FlightOutcome(verdict="FAIL" if failed else "PASS", value=value))
        return outcomes

    def find(strategy: StrategyName, seed: int) -> Findings:
        search = Search(problem, make_strategy(strategy, space, seed))
        steps = search.steps()
        outcomes: list[FlightOutcome] | None = None
        while True:
            try:
                batch = next(steps) if outcomes is None else steps.send(outcomes)
            except StopIteration:
                return search.findings
            outcomes = fly(batch, seed)

    return find


def flown(name: str, budget: int, jobs: int) -> Find:
    """Return a shipped search, flown in mode sim until its first confirmed failure."""
    start_run_server()

    def find(strategy: StrategyName, seed: int) -> Findings:
        sets = (
            f"search.strategy={strategy}",
            f"search.budget={{sim: {budget}}}",
            f"search.confirm.most={budget}",
            "search.stop_after=1",
            "search.reduce=0",
        )
        search = load_search(CAMPAIGNS / f"search-{name}.yaml", Options(seed=seed, sets=sets))
        with tempfile.TemporaryDirectory() as folder:
            engine = BatchEngine(
                clock="virtual", jobs=jobs, real_kind="embedded", watcher=SilentDisplay()
            )
            settings = SearchSettings(out=Path(folder), clock="virtual", at_once=jobs)
            return fly_search(search, settings, engine, lambda _: None).findings

    return find


def flights_of(findings: Findings) -> int:
    """Return how many flights a search flew."""
    return sum(cost.flights for cost in findings.costs.values())


def row(strategy: str, found: Sequence[Findings]) -> str:
    """Return the figures of a strategy: how often it found one, and in how many flights."""
    flights = sorted(flights_of(one) for one in found if one.confirmed)
    if not flights:
        return f"{strategy:<8} {0:>3}/{len(found)}  none confirmed"
    median = statistics.median(flights)
    return (
        f"{strategy:<8} {len(flights):>3}/{len(found)}  {median:>6g}  {flights[0]}..{flights[-1]}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("problem", choices=["made-up", "gate", "intruder"])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--budget", type=int, default=60, help="flights that look for a failure")
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    if given.problem == "made-up":
        find = made_up(given.budget, given.jobs)
    else:
        find = flown(given.problem, given.budget, given.jobs)
    print("flights to the first confirmed failure, those that confirm it included")
    print("strategy found  median  least..most")
    for strategy in STRATEGIES:
        found = [find(strategy, seed) for seed in range(1, given.seeds + 1)]
        print(row(strategy, found), flush=True)


if __name__ == "__main__":
    main()
