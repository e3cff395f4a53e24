"""Every decoder of users' files and every port, fed with mutated inputs until nothing is learned.

`python bench/fuzz.py [--inputs 100000] [--seconds 600] [--first 0] [TARGET ...]` prints a row for
each: inputs, taken, refused, failures, the longest input, growth of memory. Ends with 1 when an
input crashed, hung (10 s of the processor, or 60 s of the wall clock), took more than 1 GB, or
raised anything but a refusal. An input again:
`python -m tests.faults.fuzzing.fuzzer TARGET NUMBER 1 60 FOLDER`.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))


def fed(name: str, first: int, count: int, seconds: float) -> tuple[dict[str, Any], float]:
    """Feed a target in processes of their own; one that dies is begun again behind its input."""
    done: dict[str, Any] = {"inputs": 0, "taken": 0, "refused": 0, "failures": []}
    done |= {"longest_s": 0.0, "grown_mb": 0.0}
    began_s, end = time.monotonic(), first + count
    while first < end and (left_s := began_s + seconds - time.monotonic()) > 0.0:
        with tempfile.TemporaryDirectory(prefix="wil-fuzz-") as folder:
            words = [name, str(first), str(end - first), str(left_s), folder]
            run = subprocess.run(  # noqa: S603 - our own program
                [sys.executable, "-m", "tests.faults.fuzzing.fuzzer", *words],
                cwd=ROOT,
                check=False,
                capture_output=True,
                text=True,
                timeout=left_s + 900.0,
            )
            if run.returncode == 0:
                one = json.loads(run.stdout.splitlines()[-1])
            else:
                last = int((Path(folder) / "number").read_text())
                why = f"the process ended with {run.returncode}: {run.stderr[-600:]}"
                one = {"inputs": last - first + 1, "taken": 0, "refused": 0, "longest_s": 0.0}
                one |= {"grown_mb": 0.0, "failures": [[last, why]]}
        for key in ("inputs", "taken", "refused", "failures"):
            done[key] += one[key]
        for key in ("longest_s", "grown_mb"):
            done[key] = max(done[key], one[key])
        first += one["inputs"]
        if run.returncode == 0:
            break
    return done, time.monotonic() - began_s


def main() -> int:
    """Feed the targets and print the table."""
    from tests.faults.fuzzing.fuzzer import TARGETS  # noqa: PLC0415 - of this folder's parent

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("targets", nargs="*", metavar="TARGET")
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--first", type=int, default=0)
    options = parser.parse_args()
    print("| target | inputs | taken | refused | failures | longest | memory | time |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    failed = False
    for name in options.targets or TARGETS:
        done, took_s = fed(name, options.first, options.inputs, options.seconds)
        failed |= bool(done["failures"])
        print(
            f"| {name} | {done['inputs']} | {done['taken']} | {done['refused']} "
            f"| {len(done['failures'])} | {done['longest_s']:.2f} s | {done['grown_mb']:+.0f} MB "
            f"| {took_s:.0f} s |",
            flush=True,
        )
        for number, why in done["failures"][:5]:
            print(f"    {number}: {why}", file=sys.stderr, flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
