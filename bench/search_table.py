"""A table of a shipped search's space, flown: in it the comparison of strategies looks flights up.

    python -m bench.search_table gate --points 160 --jobs 2

Each point of a Sobol sequence is flown once in mode sim, under virtual time. The worst quarter of
them is flown four times more, each time under another seed: what passes there by luck shows.
bench/tables/<problem>.csv has a line for each flight; what it has is not flown again.
"""

import argparse
import csv
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from wil_campaign.campaigns.expansion.expansion import ExpansionOptions
from wil_campaign.campaigns.values.seeds import run_seed
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign
from wil_campaign.orchestrator.campaign.workers.run_server import start_run_server
from wil_campaign.orchestrator.cli.progress_display import SilentDisplay
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.plugins.search.engine import BatchEngine
from wil_campaign.plugins.search.exploration.learning_strategies import make_strategy
from wil_campaign.plugins.search.exploration.model import (
    FlightBatch,
    FlightOutcome,
    FlownVerdict,
    SearchFlightPlan,
    SearchVariant,
)
from wil_campaign.plugins.search.exploration.search_campaign import SearchCampaign
from wil_campaign.plugins.search.exploration.search_file import load_search
from wil_campaign.plugins.search.exploration.space import SearchSpace, Values

CAMPAIGNS = Path(__file__).parents[1] / "campaigns"
TABLES = Path(__file__).parent / "tables"
FIELDS = ("point", "flight", "verdict", "cause", "value", "duration_s", "wall_s")
SEED = 2026
"""Of the sequence and of the flights; the searches that are compared have others."""
FLIGHTS = 5
WORST = 4
"""A point among the worst 1 of so many is flown FLIGHTS times, another one once."""
_BATCH = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class TablePoint:
    """A point of the table: its variant, and what came of its flights, one for each seed."""

    variant: SearchVariant
    outcomes: tuple[FlightOutcome, ...] = ()

    @property
    def worst(self) -> float:
        """Return the smallest value of the point's flights; infinite where none showed one."""
        values = [one.value for one in self.outcomes if one.value is not None]
        return min(values, default=float("inf"))


@dataclass(frozen=True, slots=True)
class Table:
    """Flown points of a space: a flight anywhere is one of those of the nearest point."""

    space: SearchSpace
    points: tuple[TablePoint, ...]

    def outcome(self, values: Values, seed: int) -> FlightOutcome:
        """Return a flight of the nearest point, drawn by a seed."""
        wanted = self.space.shares(values)
        if wanted is None:
            raise ValueError(f"no point of the space: {values}")
        every = np.array([self.space.shares(point.variant.values) for point in self.points])
        nearest = self.points[int(np.argmin(np.sum((every - np.array(wanted)) ** 2, axis=1)))]
        drawn = int(np.random.default_rng(seed).integers(len(nearest.outcomes)))
        return nearest.outcomes[drawn]


def sequence(search: SearchCampaign) -> Iterator[SearchVariant]:
    """Yield the variants of the table in their order; those that are not flown are left out."""
    strategy = make_strategy("sobol", search.space, SEED)
    number = 0
    while (proposal := strategy.ask()) is not None:
        number += 1
        variant = SearchVariant(name=f"t{number:04d}", values=proposal.values)
        if not search.refuse(variant):
            yield variant


def read_table(name: str) -> dict[str, list[FlightOutcome]]:
    """Return what came of the flights of a problem's table, by point."""
    path = TABLES / f"{name}.csv"
    found: dict[str, list[FlightOutcome]] = {}
    if not path.is_file():
        return found
    with path.open(newline="", encoding="utf-8") as stream:
        for row in csv.DictReader(stream):
            found.setdefault(row["point"], []).append(_outcome(row))
    return found


def load_table(search: SearchCampaign, name: str) -> Table:
    """Return the table of a problem."""
    flown = read_table(name)
    variants = islice(sequence(search), len(flown))
    points = (
        TablePoint(variant=variant, outcomes=tuple(flown[variant.name])) for variant in variants
    )
    return Table(search.space, tuple(points))


def _outcome(row: dict[str, str]) -> FlightOutcome:
    verdicts: dict[str, FlownVerdict] = {"PASS": "PASS", "FAIL": "FAIL"}
    return FlightOutcome(
        verdict=verdicts.get(row["verdict"], "INVALID"),
        value=float(row["value"]) if row["value"] else None,
        cause=row["cause"],
        duration_s=float(row["duration_s"]),
        wall_s=float(row["wall_s"]),
    )


class TableFlyer:
    """Flies what a table lacks, a batch at a time, and appends it."""

    def __init__(self, search: SearchCampaign, name: str, jobs: int) -> None:
        self._search = search
        self._path = TABLES / f"{name}.csv"
        self._names = [parameter.name for parameter in search.space.parameters]
        self._engine = BatchEngine(
            cleared=ClearedCampaign("virtual", jobs), watcher=SilentDisplay()
        )

    def fly(self, flights: Iterable[SearchFlightPlan]) -> None:
        """Fly flights and write them down."""
        waiting = list(flights)
        while waiting:
            now, waiting = waiting[:_BATCH], waiting[_BATCH:]
            batch = FlightBatch(number=1, purpose="explore", mode="sim", flights=tuple(now))
            with tempfile.TemporaryDirectory() as folder:
                campaign = self._search.batch_campaign(batch)
                runs = self._engine.fly(campaign, Path(folder)).runs
            names = {f"{one.variant.name}/{one.mode}/{one.repetition}": one for one in now}
            self._append((one, runs[name]) for name, one in names.items() if name in runs)
            print(f"{len(waiting)} flights to go", flush=True)

    def _append(self, flown: Iterable[tuple[SearchFlightPlan, RunResult]]) -> None:
        TABLES.mkdir(exist_ok=True)
        is_new = not self._path.exists()
        with self._path.open("a", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            if is_new:
                writer.writerow((*FIELDS, *self._names))
            for flight, result in flown:
                if result.verdict == "ABORTED":
                    continue
                found = outcome_of(self._search, result)
                value = "" if found.value is None else f"{found.value:.4f}"
                head = (flight.variant.name, flight.repetition, found.verdict, found.cause, value)
                times = (f"{found.duration_s:.2f}", f"{found.wall_s:.2f}")
                values = (flight.variant.values[name] for name in self._names)
                writer.writerow((*head, *times, *values))


def outcome_of(search: SearchCampaign, result: RunResult) -> FlightOutcome:
    """Return a run's result as a search takes it."""
    return search.objective.outcome(
        verdict=result.verdict,
        results=result.oracles,
        vehicle=result.subject,
        cause=result.decided_by if result.verdict == "FAIL" else "",
        reason=result.reason,
        duration_s=result.duration_s or 0.0,
        wall_s=result.wall_s,
    )


def flights_of(variant: SearchVariant, numbers: Iterable[int]) -> list[SearchFlightPlan]:
    """Return flights of a point, each under a seed of its own."""
    return [
        SearchFlightPlan(variant=variant, mode="sim", repetition=one, seed_name=variant.name)
        for one in numbers
    ]


def missing(
    variants: Sequence[SearchVariant], flown: dict[str, list[FlightOutcome]]
) -> list[SearchFlightPlan]:
    """Return the first flights of points, or, where all have one, the others of the worst."""
    first = [
        f for variant in variants if variant.name not in flown for f in flights_of(variant, (1,))
    ]
    if first:
        return first
    points = [
        TablePoint(variant=variant, outcomes=tuple(flown[variant.name])) for variant in variants
    ]
    worst = sorted(points, key=lambda one: one.worst)[: len(points) // WORST]
    return [
        flight
        for one in worst
        for flight in flights_of(one.variant, range(len(one.outcomes) + 1, FLIGHTS + 1))
    ]


def shipped_search(name: str, *, seed: int, sets: tuple[str, ...] = ()) -> SearchCampaign:
    """Return a shipped search as the benchmarks fly it: without images in its recordings."""
    sets = ("record.pictures=none", *sets)
    return load_search(CAMPAIGNS / f"search-{name}.yaml", ExpansionOptions(seed=seed, sets=sets))


def flight_seed(seed: int, flight: SearchFlightPlan) -> int:
    """Return the seed of a flight of a search."""
    return run_seed(seed, flight.seed_name, flight.repetition)


def summary(table: Table) -> str:
    """Return how many points of a table failed, and how often."""
    every = [o for point in table.points for o in point.outcomes]
    failing = [p for p in table.points if any(o.verdict == "FAIL" for o in p.outcomes)]
    always = [p for p in failing if all(o.verdict == "FAIL" for o in p.outcomes)]
    unproven = sum(one.verdict not in {"PASS", "FAIL"} for one in every)
    share = 100.0 * sum(
        sum(o.verdict == "FAIL" for o in p.outcomes) / len(p.outcomes) for p in table.points
    )
    return (
        f"{len(table.points)} points, {len(every)} flights, {unproven} proved nothing; "
        f"{share / len(table.points):.1f} % of the space fails: {len(failing)} points at least "
        f"once, {len(always)} of them each time; {sum(one.wall_s for one in every):.0f} s"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("problem", choices=["gate", "intruder"])
    parser.add_argument("--points", type=int, default=160)
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    start_run_server()
    search = shipped_search(given.problem, seed=SEED)
    variants = list(islice(sequence(search), given.points))
    flyer = TableFlyer(search, given.problem, given.jobs)
    for _ in ("first", "again"):
        flyer.fly(missing(variants, read_table(given.problem)))
    print(summary(load_table(search, given.problem)))


if __name__ == "__main__":
    main()
