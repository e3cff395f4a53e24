"""A search killed in flight and resumed: does it propose and find what it would have?

    python -m bench.search_killed --moments 3 --seed 1

A search of flights of some seconds is flown once as a whole. Then each is killed by kill -9 at a
moment drawn by the seed, and resumed. search.json must be the same but for wall times, and no
flight that was finished may have been flown again.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from tests.plugins.search.searches import SEARCH, write_search

_TPE = SEARCH.replace("strategy: grid", "strategy: tpe").replace("sim: 3", "sim: 8")
_LAST_S = 600.0


def start(file: Path, *more: str) -> subprocess.Popen[bytes]:
    """Start a search of a file as a user does."""
    words = [sys.executable, "-m", "wil_campaign", "search", str(file), "--jobs", "2"]
    words += ["--out", str(file.parent / "out"), *more]
    quiet = subprocess.DEVNULL
    return subprocess.Popen(words, stdout=quiet, stderr=quiet)  # noqa: S603 - our own program


def finished_flights(folder: Path) -> dict[str, int]:
    """Return when the results of a search's flights were written, by their place."""
    found = folder.glob("out/hover/search/*/flights/*/v*/*/*/result.json")
    return {str(path): path.stat().st_mtime_ns for path in found}


def document(folder: Path) -> dict[str, Any]:
    """Return a search's document without wall times."""
    (path,) = folder.glob("out/hover/search/*/search.json")
    found: dict[str, Any] = json.loads(path.read_text("utf-8"))
    for cost in found["costs"]:
        cost["wall_s"] = 0.0
    return found


def killed(folder: Path, after_s: float) -> tuple[int, int]:
    """Fly a search, kill it, and resume it; return flights finished by then, and flown again."""
    file = write_search(folder, _TPE)
    driver = start(file)
    time.sleep(after_s)
    os.kill(driver.pid, signal.SIGKILL)
    driver.wait()
    before = finished_flights(folder)
    resumed = start(file, "--resume")
    if resumed.wait(_LAST_S) != 1:
        raise SystemExit(f"the resumed search ended with {resumed.returncode}")
    after = finished_flights(folder)
    return len(before), sum(after.get(place) != at for place, at in before.items())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--moments", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    with tempfile.TemporaryDirectory() as home:
        whole = Path(home) / "whole"
        whole.mkdir()
        began_s = time.monotonic()
        if start(write_search(whole, _TPE)).wait(_LAST_S) != 1:
            raise SystemExit("the search found nothing")
        took_s = time.monotonic() - began_s
        expected = document(whole)
        flights = len(finished_flights(whole))
        print(f"whole: {flights} flights in {took_s:.0f} s")
        for number in range(given.moments):
            folder = Path(home) / str(number)
            folder.mkdir()
            after_s = float(rng.uniform(0.25, 0.95)) * took_s
            done, again = killed(folder, after_s)
            found = document(folder)
            other = [key for key in expected if found[key] != expected[key]]
            is_same = not other and len(finished_flights(folder)) == flights
            print(
                f"killed after {after_s:.0f} s, {done} flights finished, {again} flown again: "
                f"{'the same' if is_same else 'ANOTHER'} search {' '.join(other)}",
                flush=True,
            )


if __name__ == "__main__":
    main()
