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
    if process is None and (own_mb := _own_mb()) is not None:
        return own_mb
    try:
        return float((process or _process(os.getpid())).memory_info().rss) / _MB
    except psutil.Error:
        return 0.0


def _own_mb() -> float | None:
    """Return this process's resident memory as Linux counts it; None where it does not say.

    The second number of proc_pid_statm(5), which psutil reads, too, in 60 us in place of 25: a
    run asks 20 times a second. A descriptor that was kept might be closed by anybody.
    """
    try:
        file = os.open("/proc/self/statm", os.O_RDONLY | os.O_CLOEXEC)
        try:
            pages = int(os.read(file, 256).split()[1])
        finally:
            os.close(file)
    except (OSError, ValueError, IndexError):
        return None
    return float(pages * resource.getpagesize()) / _MB


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
