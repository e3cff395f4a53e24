"""What the measurement of the mixture costs: visible pixels against projected outlines, in flight.

    python -m bench.visibility [--pairs N]

Flies `large` of gate.yaml in mode wil, with and without the measurement in turn, on one core and
in virtual time, and prints by how much the measurement slows a flight: once by the time spent in it
within each flight, once by the flights' CPU time against those without it. Quote ratios of one run.
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, RunPlan, load_campaign
from wil_campaign.orchestrator.run.flight.run import fly_one_run
from wil_campaign.orchestrator.run.perception.visibility import VisibilityProbe
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.safety.guard.core.operator_command import OperatorCommand

ROOT = Path(__file__).parents[1]
MARK = 1.03
"""A flight with the measurement takes at most so many times that without it."""


class Nobody:
    """An operator who says nothing."""

    def poll(self) -> OperatorCommand | None:
        """Return no command."""
        return None


class Timed:
    """Adds up the CPU time that calls take. spent_s: of all; calls: how many."""

    def __init__(self) -> None:
        self.spent_s = 0.0
        self.calls = 0

    def of(self, called: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function that is timed."""

        def timed(*arguments: Any) -> Any:
            began_s = time.thread_time()
            try:
                return called(*arguments)
            finally:
                self.spent_s += time.thread_time() - began_s
                self.calls += 1

        return timed


@contextmanager
def timed_measurement() -> Iterator[Timed]:
    """Time every measurement of a mixture meanwhile."""
    timed = Timed()
    with patch.object(VisibilityProbe, "measure", timed.of(VisibilityProbe.measure)):
        yield timed


@contextmanager
def no_measurement() -> Iterator[None]:
    """Have no mixture measured meanwhile."""
    with patch.object(VisibilityProbe, "measure", lambda *_: None):
        yield


def flight_cpu_s(plan: RunPlan) -> float:
    """Fly a run, and return the CPU time that it took."""
    with tempfile.TemporaryDirectory() as folder:
        setup = RunSetup.of(RunOrder(plan=plan, folder=Path(folder), clock="virtual"))
        began_s = time.process_time()
        fly_one_run(setup, lambda _: None, Nobody())
        return time.process_time() - began_s


def main() -> None:
    """Fly, and print the ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=3)
    pairs = parser.parse_args().pairs
    options = ExpansionOptions(cases=("large",), modes=("wil",), sets=("controls={}",))
    plan = load_campaign(ROOT / "campaigns/gate.yaml", options).runs[0]
    flight_cpu_s(plan)  # compiles, and fills caches
    inside: list[float] = []
    beside: list[float] = []
    calls, spent_s = 0, 0.0
    for _ in range(pairs):
        with no_measurement():
            without_s = flight_cpu_s(plan)
        with timed_measurement() as timed:
            with_s = flight_cpu_s(plan)
        inside.append(with_s / (with_s - timed.spent_s))
        beside.append(with_s / without_s)
        calls, spent_s = calls + timed.calls, spent_s + timed.spent_s
    print(f"mixtures: {calls / pairs:.0f} a flight, {spent_s / calls * 1e3:.2f} ms each on average")
    print(
        f"a flight with the measurement takes {statistics.median(inside):.3f} times that without "
        f"it, by the time spent in it (mark: at most {MARK:g})"
    )
    print(f"  {statistics.median(beside):.3f} times by whole flights, {pairs} pairs")


if __name__ == "__main__":
    main()
