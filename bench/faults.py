"""Seeded faults: injected, survived, lost. In virtual time, and of real processes.

`python bench/faults.py [--virtual 216] [--troubles 60] [--real 16] [--real-troubles 11]
[--first 0] [--jobs 1]`; ends with 1 when anything was lost. Virtual: who is killed or stopped;
troubles: blackouts, hostile frames, disks, clocks. One fault again:
`python -m tests.faults.virtual SEED 1 FOLDER [troubles]`, or
`python -m tests.faults.processes SEED 1 FOLDER [troubles]`.
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
KINDS = (
    ("virtual", "virtual time: killed or stopped", ("virtual",)),
    ("troubles", "virtual time: other troubles", ("virtual", "troubles")),
    ("real", "real processes: kill -9 and SIGSTOP", ("processes",)),
    ("real_troubles", "real processes: other troubles", ("processes", "troubles")),
)
"""Option, title, module with its further arguments."""


def injected(kind: tuple[str, ...], first: int, count: int, folder: Path) -> list[dict[str, Any]]:
    """Inject some faults in a process of its own; a fault that ended that process is lost."""
    module, *further = kind
    arguments = [str(first), str(count), str(folder / f"{'-'.join(kind)}-{first}"), *further]
    done = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-m", f"tests.faults.{module}", *arguments],
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


def in_shares(
    kind: tuple[str, ...], first: int, count: int, jobs: int, folder: Path
) -> list[dict[str, Any]]:
    """Inject faults with so many processes at once."""
    share = max(1, -(-count // (4 * jobs))) if kind[0] == "virtual" else max(1, count)
    starts = range(first, first + count, share)
    with ThreadPoolExecutor(jobs) as pool:
        parts = pool.map(
            lambda start: injected(kind, start, min(share, first + count - start), folder),
            starts,
        )
        return [one for part in parts for one in part]


def tell(title: str, found: list[dict[str, Any]], wall_s: float) -> int:
    """Print what came of them; return how many were lost."""
    lost = [one for one in found if one["lost"]]
    idle = [one for one in found if not one["lost"] and one.get("hit") in {False, "nobody"}]
    survived = len(found) - len(lost) - len(idle)
    print(f"{title}: {len(found) - len(idle)} injected, {survived} survived, {len(lost)} lost")
    if idle:
        print(f"  {len(idle)} more hit nobody: the victim was gone already")
    victims = sorted({_what(one) for one in found})
    for victim in victims:
        own = [one for one in found if _what(one) == victim]
        verdicts = Counter(one["verdict"] or "no verdict" for one in own)
        said = ", ".join(f"{number} {verdict}" for verdict, number in sorted(verdicts.items()))
        acted_s = [one["acted_s"] for one in own if one.get("acted_s") is not None]
        when = ""
        if acted_s:
            middle = statistics.median(acted_s)
            when = f"; the guard acted after {middle:.2f} s (median), {max(acted_s):.2f} s (worst)"
        print(f"  {victim}: {len(own)} ({said}){when}")
    for one in lost:
        print(
            f"  LOST {one['fault']}: {'; '.join(one['lost'])} [{one['verdict']}: {one['reason']}]"
        )
    print(f"  in {wall_s:.0f} s")
    return len(lost)


def _what(one: dict[str, Any]) -> str:
    fault = one["fault"]
    return f"{fault['victim']}, {fault.get('kind') or fault.get('action', '')}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--virtual", type=int, default=216)
    parser.add_argument("--troubles", type=int, default=60)
    parser.add_argument("--real", type=int, default=16)
    parser.add_argument("--real-troubles", type=int, default=11)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    asked = parser.parse_args()
    lost = 0
    with tempfile.TemporaryDirectory(prefix="wil-faults-") as folder:
        for option, title, kind in KINDS:
            count = getattr(asked, option)
            if not count:
                continue
            # A flight under the wall clock needs a core; two at once would test the machine.
            jobs = asked.jobs if kind[0] == "virtual" else 1
            began_s = time.monotonic()
            found = in_shares(kind, asked.first, count, jobs, Path(folder))
            lost += tell(title, found, time.monotonic() - began_s)
            sys.stdout.flush()
    sys.exit(1 if lost else 0)


if __name__ == "__main__":
    main()
