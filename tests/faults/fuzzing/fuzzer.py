"""Feeds one target with mutated inputs and says what became of them.

A program of its own: `python -m tests.faults.fuzzing.fuzzer TARGET FIRST COUNT SECONDS`. Each input
follows from the target and its number alone, so that a failure is had again by `FIRST 1`. Memory
beyond what the valid inputs need is limited to 1 GB, an input's time to 10 s of the processor and
60 s of the wall clock: a machine that is busy makes no hang.
"""

import ctypes
import json
import os
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path

import psutil

from tests.faults.fuzzing.file_targets import FILE_TARGETS
from tests.faults.fuzzing.mutations import mutated
from tests.faults.fuzzing.port_targets import PORT_TARGETS
from tests.faults.fuzzing.targets import Prepared, Target

TARGETS = {target.name: target for target in (*FILE_TARGETS, *PORT_TARGETS)}
MEMORY_BYTES = 1 << 30
LONGEST_CPU_S = 10.0
LONGEST_WALL_S = 60.0
_MOST_FAILURES = 20
_MALLOC_TRIM = getattr(ctypes.CDLL(None), "malloc_trim", None)
_SETTLED = 500
"""Inputs after which growth of memory counts."""


@dataclass(slots=True)
class Fed:
    """What became of a target's inputs. failures: number and traceback of each."""

    target: str
    inputs: int = 0
    taken: int = 0
    refused: int = 0
    longest_s: float = 0.0
    grown_mb: float = 0.0
    failures: list[tuple[int, str]] = field(default_factory=list)


class _TooSlowError(BaseException):
    """An input took too long; no target may catch it."""


def input_of(target: Target, prepared: Prepared, number: int) -> bytes:
    """Return a target's input of a number."""
    rng = random.Random(f"{target.name} {number}")  # noqa: S311 - repeatable
    return mutated(rng, prepared.seeds)


def feed(
    target: Target, folder: Path, first: int, count: int, *, within_s: float = float("inf")
) -> Fed:
    """Feed a target with inputs of consecutive numbers, as far as they are done in time."""
    prepared = target.prepare(folder)
    fed = Fed(target.name)
    end_s = time.monotonic() + within_s
    settled_mb = 0.0
    for number in range(first, first + count):
        if time.monotonic() > end_s or len(fed.failures) >= _MOST_FAILURES:
            break
        data = input_of(target, prepared, number)
        (folder / "number").write_text(str(number))
        began_s = time.monotonic()
        try:
            with _alarm(), warnings.catch_warnings():
                warnings.simplefilter("error", RuntimeWarning)  # a division by zero, a NaN
                prepared.take(data)
            fed.taken += 1
        except target.refusals:
            fed.refused += 1
        except (Exception, _TooSlowError):  # noqa: BLE001 - that is what is sought
            fed.failures.append((number, traceback.format_exc(limit=-4)))
        fed.inputs += 1
        fed.longest_s = max(fed.longest_s, time.monotonic() - began_s)
        if fed.inputs == max(1, min(_SETTLED, count // 10)):
            settled_mb = _rss_mb()
    fed.grown_mb = _rss_mb() - settled_mb if settled_mb else 0.0
    return fed


@contextmanager
def _alarm() -> Iterator[None]:
    """Raise _TooSlowError in what takes too long of the processor, or waits for too long."""
    limits = (
        (signal.SIGPROF, signal.ITIMER_PROF, LONGEST_CPU_S, "of the processor"),
        (signal.SIGALRM, signal.ITIMER_REAL, LONGEST_WALL_S, "of the wall clock"),
    )
    texts = {number: f"longer than {limit_s:g} s {of}" for number, _, limit_s, of in limits}

    def ring(number: int, frame: object) -> None:
        raise _TooSlowError(texts[signal.Signals(number)])

    before = {number: signal.signal(number, ring) for number, *_ in limits}
    for _, timer, limit_s, _ in limits:
        signal.setitimer(timer, limit_s)
    try:
        yield
    finally:
        for _, timer, *_ in limits:
            signal.setitimer(timer, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler)


def _rss_mb() -> float:
    if _MALLOC_TRIM is not None:
        _MALLOC_TRIM(0)  # what the C library keeps for the next input is no growth
    return psutil.Process(os.getpid()).memory_info().rss / 1e6


def main() -> int:
    """Feed a target and print what became of it as JSON."""
    name, first, count, within_s, folder = sys.argv[1:]
    target = TARGETS[name]
    if target.takes_seeds:  # what is imported and compiled for them is no memory of an input
        with tempfile.TemporaryDirectory() as warm:
            prepared = target.prepare(Path(warm))
            for seed in prepared.seeds:
                prepared.take(seed)
    used = psutil.Process(os.getpid()).memory_info().vms
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY_BYTES,) * 2)
    fed = feed(target, Path(folder), int(first), int(count), within_s=float(within_s))
    print(json.dumps(asdict(fed)))  # noqa: T201 - its answer
    return 0


if __name__ == "__main__":
    sys.exit(main())
