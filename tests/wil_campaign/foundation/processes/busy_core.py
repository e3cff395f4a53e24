"""A busy machine, made on purpose: many programs on one core."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager


@contextmanager
def one_busy_core(programs: int) -> Iterator[None]:
    """Have this process, and what it starts, share one core with busy programs."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    busy = (sys.executable, "-c", "while True: pass")
    try:
        with ExitStack() as stack:
            for _ in range(programs):
                program = stack.enter_context(subprocess.Popen(busy))  # noqa: S603 - our own
                stack.callback(program.kill)
            yield
    finally:
        os.sched_setaffinity(0, cores)
