"""Flights that must fail, each with a seeded fault: in virtual time, and on sockets.

`python bench/must_fail.py RESULTS [--virtual 500] [--field 500] [--truth 200] [--sockets 60]
[--first 0] [--jobs 1]` appends one JSON line for each flight to the file RESULTS, leaves out what
stands there already, and prints the tables of docs/decisions/0049. `--undisturbed` flies each
mission without a fault instead, and `--mutants` each mutant of the product. Ends with 1 when a
flight passed that must not, or a mutant was not found. One flight again: `python -m
tests.faults.signals SEED 1 FOLDER`, with `field_faults`, `ground_truth` or `socket_flights` in its
place.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
SHARE = 100
"""Flights of one process: what it leaves behind in memory goes with it."""
VERDICTS = ("FAIL", "INVALID", "ERROR", "ABORTED", "refused", "PASS")
UNDISTURBED = 144
"""Missions without a fault: 16 of 9 combinations each."""
FIELD = ("heading", "estimator's hold", "second sender", "ground station", "mesh", "retry")
MODULES = {
    "virtual": "signals",
    "field": "field_faults",
    "truth": "ground_truth",
    "sockets": "socket_flights",
    "undisturbed": "undisturbed",
}


def fly(kind: str, first: int, count: int, results: Path) -> None:
    """Fly some in a process of its own; what ended that process is a flight without a verdict."""
    with tempfile.TemporaryDirectory(prefix="wil-must-fail-") as folder, results.open("a") as out:
        words = [sys.executable, "-m", f"tests.faults.{MODULES[kind]}"]
        words += [str(first), str(count), folder]
        with subprocess.Popen(  # noqa: S603 - our own program
            words, cwd=ROOT, stdout=subprocess.PIPE, text=True
        ) as process:
            for line in process.stdout or ():
                flown = {"kind": kind, **json.loads(line)}
                out.write(json.dumps(flown) + "\n")
                out.flush()


def read(results: Path) -> list[dict[str, Any]]:
    """Return the flights of a file, the last line perhaps cut off."""
    if not results.exists():
        return []
    lines = results.read_text("utf-8").rpartition("\n")[0].splitlines()
    return [json.loads(line) for line in lines]


def shares(due: Iterable[int]) -> Iterator[tuple[int, int]]:
    """Yield first and count of runs of seeds that follow each other, at most SHARE at once."""
    run: list[int] = []
    for seed in due:
        if run and (seed != run[-1] + 1 or len(run) == SHARE):
            yield run[0], len(run)
            run = []
        run.append(seed)
    if run:
        yield run[0], len(run)


def fly_due(kind: str, first: int, count: int, results: Path, jobs: int) -> None:
    """Fly the seeds that are not among the results yet."""
    flown = {one["fault"]["seed"] for one in read(results) if one["kind"] == kind}
    due = [seed for seed in range(first, first + count) if seed not in flown]
    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(lambda share: fly(kind, *share, results), shares(due)))


def tables(flights: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the lines of the tables."""
    titles = {
        "virtual": "in virtual time",
        "field": "with faults of the field in virtual time",
        "truth": "judged by a simulator's ground truth",
        "sockets": "on sockets",
    }
    for kind, title in titles.items():
        own = [flight for flight in flights if flight["kind"] == kind]
        if not own:
            continue
        verdicts = Counter(one["verdict"] for one in own)
        counts = ", ".join(
            f"{verdicts[verdict]} {verdict}" for verdict in VERDICTS if verdicts[verdict]
        )
        exempt = [one for one in own if one["exempt"] and one["verdict"] == "PASS"]
        yield f"{len(own)} flights {title}: {counts}; {len(exempt)} of the PASS exempt"
        yield ""
        field = [one for one in own if one["fault"]["signal"] in FIELD]
        if field:
            yield from _field_table(field)
            yield ""
        own = [one for one in own if one not in field]
        if not own:
            continue
        yield from _table(own, "cause", lambda one: one["fault"]["cause"])
        yield ""
        yield from _table(own, "what is faulty", lambda one: one["fault"]["signal"])
        yield ""
        for one in exempt:
            if one not in own:
                continue
            fault = one["fault"]
            offset = ", ".join(f"{by:.2f}" for by in fault["alteration"]["offset_m"])
            what = f"{fault['signal']} {fault['alteration']['kind']} by ({offset}) m"
            yield f"- exempt: seed {fault['seed']}, {fault['cause']}: {what} in {fault['stage']}"


def _field_table(flights: list[dict[str, Any]]) -> Iterator[str]:
    """Yield a line for each fault, with the seeds that are exempt and passed."""
    yield f"| what is faulty | how | flights | {' | '.join(VERDICTS)} | exempt |"
    yield "|---" * (len(VERDICTS) + 4) + "|"
    names = [
        (flight["fault"]["signal"], flight["fault"]["alteration"]["kind"]) for flight in flights
    ]
    for signal, how in sorted(set(names)):
        own = [flight for flight, name in zip(flights, names, strict=True) if name == (signal, how)]
        verdicts = Counter(one["verdict"] for one in own)
        passed = [one for one in own if one["exempt"] and one["verdict"] == "PASS"]
        seeds = ", ".join(str(one["fault"]["seed"]) for one in passed)
        counts = " | ".join(str(verdicts[verdict]) for verdict in VERDICTS)
        yield f"| {signal} | {how} | {len(own)} | {counts} | {seeds} |"


def _table(flights: list[dict[str, Any]], head: str, row_of: Any) -> Iterator[str]:
    kinds = sorted({flight["fault"]["alteration"]["kind"] for flight in flights})
    yield f"| {head} | {' | '.join(kinds)} | all |"
    yield "|---" * (len(kinds) + 2) + "|"
    for row in sorted({row_of(flight) for flight in flights}):
        own = [flight for flight in flights if row_of(flight) == row]
        cells = [
            _cell([one for one in own if one["fault"]["alteration"]["kind"] == kind])
            for kind in kinds
        ]
        yield f"| {row} | {' | '.join(cells)} | {_cell(own)} |"


def _cell(flights: list[dict[str, Any]]) -> str:
    """Return FAIL/INVALID/ERROR/PASS as "12/3/0/0"."""
    verdicts = Counter(flight["verdict"] for flight in flights)
    counts = [verdicts[one] for one in ("FAIL", "INVALID", "ERROR", "PASS")]
    return "/".join(map(str, counts)) if flights else ""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path)
    parser.add_argument("--virtual", type=int, default=500)
    parser.add_argument("--field", type=int, default=500)
    parser.add_argument("--truth", type=int, default=200)
    parser.add_argument("--sockets", type=int, default=60)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--undisturbed", action="store_true")
    parser.add_argument("--mutants", action="store_true")
    asked = parser.parse_args()
    if asked.mutants:
        words = [sys.executable, "-m", "tests.faults.mutants"]
        return subprocess.run(words, cwd=ROOT, check=False).returncode  # noqa: S603 - our own
    if asked.undisturbed:
        fly_due("undisturbed", asked.first, UNDISTURBED, asked.results, asked.jobs)
    else:
        fly_due("virtual", asked.first, asked.virtual, asked.results, asked.jobs)
        fly_due("field", asked.first, asked.field, asked.results, asked.jobs)
        fly_due("truth", asked.first, asked.truth, asked.results, asked.jobs)
        fly_due("sockets", asked.first, asked.sockets, asked.results, 1)
    flights = read(asked.results)
    print("\n".join(tables(flights)))
    wrong = [flight for flight in flights if flight["wrong"]]
    for one in wrong:
        print(f"WRONG {one['verdict']}: {one['fault']} [{one['reason']}]")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
