"""Processes that a run's own code leaves behind end with the run."""

import os
from contextlib import suppress

import psutil

from vehicles.processes.linux import UnsupportedSystemError, adopt_orphans

_GRACE_S = 1.0


def adopt_descendants() -> None:
    """Have what this process's descendants leave behind become its own, where Linux is."""
    with suppress(UnsupportedSystemError):
        adopt_orphans()


def end_descendants() -> list[str]:
    """End all processes below this one, by SIGTERM and a second later SIGKILL.

    Returns what they are called. For the end of a run: its guard and its vehicles have ended.
    """
    left = psutil.Process(os.getpid()).children(recursive=True)
    names = []
    for process in left:
        with suppress(psutil.Error):
            names.append(f"{process.name()} (process {process.pid})")
            process.terminate()
    _, alive = psutil.wait_procs(left, timeout=_GRACE_S)
    for process in alive:
        with suppress(psutil.Error):
            process.kill()
    psutil.wait_procs(alive, timeout=_GRACE_S)
    return names
