"""Seeded faults: injected, survived, lost. In virtual time, and of real processes.

`python bench/faults.py [--virtual 216] [--troubles 60] [--real 16] [--real-troubles 11]
[--first 0] [--jobs 1] [--keep DIR]`; exits with 1 when anything was lost. Virtual: processes are
killed or stopped; troubles: link outages, hostile frames, disks, clocks. With --keep each result is
written as a line of a file in DIR, and faults with a result there are not injected again. One
again:
`python -m tests.faults.virtual SEED 1 FOLDER [troubles]`, or
`python -m tests.faults.processes SEED 1 FOLDER [troubles]`.
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import threading
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


class Kept:
    """The results of one kind of faults, in a file as they come; without a folder in no file."""

    def __init__(self, folder: Path | None, name: str) -> None:
        self._lock = threading.Lock()
        self._path = None if folder is None else folder / f"{name}.jsonl"
        self.found: dict[int, dict[str, Any]] = {}
        if self._path is not None and self._path.is_file():
            text = self._path.read_text("utf-8")
            whole = text[: text.rfind("\n") + 1]  # the last line may be cut
            if whole != text:
                self._path.write_text(whole, "utf-8")
            for line in whole.splitlines():
                one = json.loads(line)
                self.found[one["fault"]["seed"]] = one

    def take(self, one: dict[str, Any]) -> None:
        """Take the result of a fault."""
        with self._lock:
            self.found[one["fault"]["seed"]] = one
            if self._path is not None:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                with self._path.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps(one) + "\n")


def inject(kind: tuple[str, ...], first: int, count: int, folder: Path, kept: Kept) -> None:
    """Inject some faults in a process of its own; a fault that ended that process is lost."""
    module, *further = kind
    arguments = [str(first), str(count), str(folder / f"{'-'.join(kind)}-{first}"), *further]
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as err:
        with subprocess.Popen(  # noqa: S603 - our own program
            [sys.executable, "-m", f"tests.faults.{module}", *arguments],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=err,
            text=True,
        ) as process:
            for line in process.stdout or ():
                kept.take(json.loads(line))
        err.seek(0)
        errors = err.read().strip()[-500:]
    for seed in range(first, first + count):
        if seed not in kept.found:
            fault = {"seed": seed, "victim": "?"}
            lost = [f"the injector ended: {errors}"]
            # In no file: an injector that was interrupted is to begin it again.
            kept.found[seed] = {"fault": fault, "verdict": None, "reason": "", "lost": lost}


def in_shares(
    kind: tuple[str, ...], seeds: range, jobs: int, folder: Path, kept: Kept
) -> list[dict[str, Any]]:
    """Inject faults with so many processes at once; those that are kept already are left out."""
    share = max(1, -(-len(seeds) // (4 * jobs))) if kind[0] == "virtual" else max(1, len(seeds))
    shares: list[tuple[int, int]] = []
    for seed in seeds:
        if seed in kept.found:
            continue
        if shares and sum(shares[-1]) == seed and shares[-1][1] < share:
            shares[-1] = (shares[-1][0], shares[-1][1] + 1)
        else:
            shares.append((seed, 1))
    with ThreadPoolExecutor(jobs) as pool:
        for done in [pool.submit(inject, kind, *one, folder, kept) for one in shares]:
            done.result()
    return [kept.found[seed] for seed in seeds]


def tell(title: str, found: list[dict[str, Any]], wall_s: float) -> int:
    """Print what came of them; return how many were lost."""
    lost = [one for one in found if one["lost"]]
    idle = [one for one in found if not one["lost"] and one.get("hit") in {False, "nobody"}]
    survived = len(found) - len(lost) - len(idle)
    print(f"{title}: {len(found) - len(idle)} injected, {survived} survived, {len(lost)} lost")
    if idle:
        print(f"  {len(idle)} more hit nobody: the victim was gone already")
    opened = sum(one.get("sockets", 0) for one in found)
    if opened:
        swept = sum(one.get("swept", 0) for one in found)
        print(
            f"  {opened} sockets seen; {swept} files of killed processes, removed by a next start"
        )
    victims = sorted({_what(one) for one in found})
    for victim in victims:
        own = [one for one in found if _what(one) == victim]
        verdicts = Counter(one["verdict"] or "no verdict" for one in own)
        counts = ", ".join(f"{number} {verdict}" for verdict, number in sorted(verdicts.items()))
        acted_s = [one["acted_s"] for one in own if one.get("acted_s") is not None]
        when = ""
        if acted_s:
            middle = statistics.median(acted_s)
            when = f"; the guard acted after {middle:.2f} s (median), {max(acted_s):.2f} s (worst)"
        print(f"  {victim}: {len(own)} ({counts}){when}")
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
    parser.add_argument("--keep", type=Path)
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
            seeds = range(asked.first, asked.first + count)
            kept = Kept(asked.keep, option)
            found = in_shares(kind, seeds, jobs, Path(folder), kept)
            lost += tell(title, found, time.monotonic() - began_s)
            sys.stdout.flush()
    sys.exit(1 if lost else 0)


if __name__ == "__main__":
    main()
