"""Resident memory of processes, and a kernel limit on this process's allocations."""

import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache

import psutil

_MB = 1_000_000


def resident_mb(process: psutil.Process | None = None) -> float:
    """Return the resident memory of a process (default: this one), in 10^6 bytes; 0 if it ended."""
    try:
        return float((process or _process(os.getpid())).memory_info().rss) / _MB
    except psutil.Error:
        return 0.0


@lru_cache(maxsize=1)
def _process(pid: int) -> psutil.Process:
    """Return a process, cached: to identify it costs 20 times as much as reading its memory."""
    return psutil.Process(pid)


@contextmanager
def limited_allocation(growth_mb: float) -> Iterator[None]:
    """Limit this process's allocations to its present memory plus `growth_mb`.

    Beyond that they raise MemoryError, or what else the allocating code makes of it. Private
    writable memory counts, resident or not (RLIMIT_DATA); reserved address space does not. Children
    that are started meanwhile have the same limit. Without effect on systems that do not count it.
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
