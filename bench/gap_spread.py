"""How far modes are from reality when the spread of each mode is taken into account.

    python -m bench.gap_spread RESULTS_FOLDER

The mean distance between flights of two modes is small where one of them has little spread, though
its flights are not like the other's. The energy distance (Szekely and Rizzo 2013) takes that out:
twice the mean distance between two modes less the mean distances within both, 0 for modes that
fly alike. Repetitions of one number have one seed in all modes, and so the same gusts and the same
walk: pairs of such flights are left out, as a flight is not compared with itself. Prints spreads
and energy distances, by case and measure of behaviour, and their means over the cases.
"""

import argparse
from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np

from orchestrator.analysis.gap.measures import MEASURES, Measure
from orchestrator.analysis.gap.motion import RunMotion, read_motion
from orchestrator.analysis.pass_rates import is_proven
from orchestrator.analysis.reading.results_folder import read_campaign

MODES = ("sim", "wil")


Flights = dict[str, RunMotion]
"""The flights of one case and mode, by their repetition."""


def read_flights(folder: Path) -> dict[tuple[str, str], Flights]:
    """Return the motions of a results folder's runs that came to PASS or FAIL, without controls."""
    flights: dict[tuple[str, str], Flights] = {}
    for entry in read_campaign(folder).entries:
        run = entry.result
        if run is not None and run.control is None and is_proven(run):
            motion = read_motion(folder / entry.name, run.subject)
            flights.setdefault((entry.case, entry.mode), {})[entry.rep] = motion
    return flights


def mean(values: Sequence[float | None]) -> float:
    """Return the mean of distances; NaN without any."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else float("nan")


def between(one: Flights, other: Flights, measure: Measure) -> float:
    """Return the mean distance between flights of two modes, or of one, of different seeds."""
    pairs = product(one.items(), other.items())
    return mean([measure.between(a, b) for (rep, a), (rep_b, b) in pairs if rep != rep_b])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    flights = read_flights(parser.parse_args().folder)
    cases = [case for case, mode in flights if mode == "real"]
    print(f"{'case':12} {'measure':8} {'within real':>11} {'sim':>6} {'wil':>6}", end="")
    print(f" {'energy real-sim':>15} {'real-wil':>9}")
    for measure in (one for one in MEASURES if one.part == "behaviour"):
        totals: list[tuple[float, ...]] = []
        for case in cases:
            real = flights[case, "real"]
            spread = [between(real, real, measure)]
            energy: list[float] = []
            for mode in MODES:
                other = flights.get((case, mode), {})
                spread.append(between(other, other, measure))
                energy.append(2.0 * between(real, other, measure) - spread[0] - spread[-1])
            totals.append((*spread, *energy))
            show(case, measure, totals[-1])
        show("all cases", measure, np.mean(totals, axis=0))


def show(case: str, measure: Measure, row: Sequence[float]) -> None:
    """Print one row."""
    a, b, c, d, e = row
    print(f"{case:12} {measure.name:8} {a:11.3f} {b:6.3f} {c:6.3f} {d:15.3f} {e:9.3f}")


if __name__ == "__main__":
    main()
