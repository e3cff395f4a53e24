"""Processes that a run's own code leaves behind end with the run."""

import os
from collections.abc import Iterator
from contextlib import suppress

import psutil

from vehicles.processes.linux import UnsupportedSystemError, adopt_orphans

_GRACE_S = 1.0
_OURS = ("safety.", "vehicles.")
"""Packages whose programs end by themselves: a guard that still lands, and what it lands."""


def adopt_descendants() -> None:
    """Have what this process's descendants leave behind become its own, where Linux is."""
    with suppress(UnsupportedSystemError):
        adopt_orphans()


def end_descendants() -> list[str]:
    """End the processes below this one, by SIGTERM and a second later SIGKILL.

    Left alone are guards, vehicles and their supervisors with all that is below them: a guard
    outlives a run that failed until its vehicles are down, and ends them. Returns what the ended
    processes are called. Never raises: a run's result is still to be handed over.
    """
    left: list[psutil.Process] = []
    names: list[str] = []
    with suppress(psutil.Error, OSError):
        left = list(_below(psutil.Process(os.getpid())))
    for process in left:
        with suppress(psutil.Error, OSError):
            names.append(f"{process.name()} (process {process.pid})")
            process.terminate()
    for process in _alive(left):
        with suppress(psutil.Error, OSError):
            process.kill()
    _alive(left)
    return names


def _below(parent: psutil.Process) -> Iterator[psutil.Process]:
    """Yield the processes below one, except ours, ended ones, and what is below those."""
    for child in parent.children():
        with suppress(psutil.Error, OSError):
            if child.status() == psutil.STATUS_ZOMBIE or _is_ours(child.cmdline()):
                continue
            yield child
            yield from _below(child)


def _is_ours(words: list[str]) -> bool:
    """Return whether a command line is that of one of our programs, `python -m MODULE ...`."""
    return len(words) > 2 and words[1] == "-m" and words[2].startswith(_OURS)


def _alive(processes: list[psutil.Process]) -> list[psutil.Process]:
    """Wait for processes to end; return those that did not within the grace."""
    with suppress(psutil.Error, OSError):
        return psutil.wait_procs(processes, timeout=_GRACE_S)[1]
    return processes
