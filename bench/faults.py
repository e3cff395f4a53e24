"""Seeded kills: injected, survived, lost. In virtual time, and of real processes.

`python bench/faults.py [--virtual 200] [--real 20] [--first 0] [--jobs 2]`; ends with 1 when
anything was lost. One kill again: `python -m tests.faults.virtual SEED 1 FOLDER`, or
`python -m tests.faults.processes SEED 1 FOLDER`.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]


def injected(kind: str, first: int, count: int, folder: Path) -> list[dict[str, Any]]:
    """Inject some faults in a process of its own; a fault that ended that process is lost."""
    arguments = [str(first), str(count), str(folder / f"{kind}-{first}")]
    done = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-m", f"tests.faults.{kind}", *arguments],
        cwd=ROOT,
        check=False,
        capture_output=True,
        text=True,
    )
    found = [json.loads(line) for line in done.stdout.splitlines()]
    for seed in range(first + len(found), first + count):
        fault = {"seed": seed, "victim": "?"}
        lost = [f"the injector ended: {done.stderr.strip()[-500:]}"]
        found.append({"fault": fault, "verdict": None, "reason": "", "lost": lost})
    return found


def in_shares(kind: str, first: int, count: int, jobs: int, folder: Path) -> list[dict[str, Any]]:
    """Inject faults with so many processes at once."""
    share = max(1, -(-count // (4 * jobs)))
    starts = range(first, first + count, share)
    with ThreadPoolExecutor(jobs) as pool:
        parts = pool.map(
            lambda start: injected(kind, start, min(share, first + count - start), folder), starts
        )
        return [one for part in parts for one in part]


def tell(title: str, found: list[dict[str, Any]], wall_s: float) -> int:
    """Print what came of them; return how many were lost."""
    lost = [one for one in found if one["lost"]]
    print(f"{title}: {len(found)} injected, {len(found) - len(lost)} survived, {len(lost)} lost")
    victims = Counter(one["fault"]["victim"] for one in found)
    for victim, count in sorted(victims.items()):
        own = [one for one in found if one["fault"]["victim"] == victim]
        verdicts = Counter(one["verdict"] or "no verdict" for one in own)
        said = ", ".join(f"{number} {verdict}" for verdict, number in sorted(verdicts.items()))
        print(f"  {victim}: {count} ({said})")
    for one in lost:
        print(
            f"  LOST {one['fault']}: {'; '.join(one['lost'])} [{one['verdict']}: {one['reason']}]"
        )
    print(f"  in {wall_s:.0f} s")
    return len(lost)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--virtual", type=int, default=200)
    parser.add_argument("--real", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    lost = 0
    with tempfile.TemporaryDirectory(prefix="wil-faults-") as folder:
        for title, kind, count, jobs in (
            ("virtual time", "virtual", asked.virtual, asked.jobs),
            # A flight under the wall clock needs a core; two at once would test the machine.
            ("real processes", "processes", asked.real, 1),
        ):
            began_s = time.monotonic()
            found = in_shares(kind, asked.first, count, jobs, Path(folder)) if count else []
            lost += tell(title, found, time.monotonic() - began_s)
    sys.exit(1 if lost else 0)


if __name__ == "__main__":
    main()
