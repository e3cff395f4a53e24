"""Memory of processes: what they hold, and a limit of the kernel on what one asks for."""

import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache

import psutil

_MB = 1_000_000


def resident_mb(process: psutil.Process | None = None) -> float:
    """Return what a process holds in memory, in 10^6 bytes: this one; 0 for one that ended."""
    try:
        return float((process or _process(os.getpid())).memory_info().rss) / _MB
    except psutil.Error:
        return 0.0


@lru_cache(maxsize=1)
def _process(pid: int) -> psutil.Process:
    """Return a process, kept: to identify it costs 20 times what its memory does."""
    return psutil.Process(pid)


@contextmanager
def limited_allocation(growth_mb: float) -> Iterator[None]:
    """Have what this process asks for beyond its memory of now and `growth_mb` be refused.

    It then raises MemoryError, or what else the code that asks makes of it. Counted is private
    memory that may be written to, held or not (RLIMIT_DATA); what is only reserved is not. Children
    that are started meanwhile have the same limit. Without effect where the system does not count.
    """
    used = getattr(psutil.Process().memory_info(), "data", None)
    if used is None:
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    wanted = int(used + growth_mb * _MB)
    lower = min(each for each in (wanted, soft, hard) if each != resource.RLIM_INFINITY)
    resource.setrlimit(resource.RLIMIT_DATA, (lower, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))
