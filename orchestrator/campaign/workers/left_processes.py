"""Ends the processes and threads that the code of a run has started and left running."""

import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress

import psutil

from wil_campaign.foundation.processes.linux import UnsupportedSystemError, adopt_orphans

_GRACE_S = 1.0
_OURS = ("wil_campaign.safety.", "wil_campaign.vehicles.")
"""Packages whose programs end by themselves: a guard that is still landing, and its vehicles."""


def adopt_descendants() -> None:
    """Make orphaned processes of descendants children of this process (Linux only)."""
    with suppress(UnsupportedSystemError):
        adopt_orphans()


def end_descendants() -> list[str]:
    """End the processes below this one, by SIGTERM and a second later SIGKILL.

    Guards, vehicles and their supervisors are spared with their descendants: after a failed run a
    guard lives until its vehicles are down, and then ends them. Returns the names of the ended
    processes. Never raises: the run's result is still to be sent.
    """
    left: list[psutil.Process] = []
    names: list[str] = []
    with suppress(psutil.Error, OSError):
        left = list(_descendants(psutil.Process(os.getpid())))
    for process in left:
        with suppress(psutil.Error, OSError):
            names.append(f"{process.name()} (process {process.pid})")
            process.terminate()
    for process in _await_end(left):
        with suppress(psutil.Error, OSError):
            process.kill()
    _await_end(left)
    return names


def end_despite_threads() -> None:
    """End this process without its threads, where one that is no daemon would keep it alive.

    Python waits for those without end: code of a user that goes on in one would hang the process.
    """
    threads = [one for one in threading.enumerate() if one is not threading.current_thread()]
    begun_s = time.monotonic()
    for thread in threads:
        if not thread.daemon:
            thread.join(max(0.0, begun_s + _GRACE_S - time.monotonic()))
    left = [one.name for one in threads if one.is_alive() and not one.daemon]
    if left:
        sys.stderr.write(f"a run left threads running, and ends without them: {', '.join(left)}\n")
        sys.stderr.flush()
        os._exit(0)


def _descendants(parent: psutil.Process) -> Iterator[psutil.Process]:
    """Yield the descendants of a process, except ours, ended ones, and those below them."""
    for child in parent.children():
        with suppress(psutil.Error, OSError):
            if child.status() == psutil.STATUS_ZOMBIE or _is_ours(child.cmdline()):
                continue
            yield child
            yield from _descendants(child)


def _is_ours(words: list[str]) -> bool:
    """Return whether a command line is that of one of our programs, `python -P -m MODULE ...`."""
    return words[1:3] == ["-P", "-m"] and words[3:] != [] and words[3].startswith(_OURS)


def _await_end(processes: list[psutil.Process]) -> list[psutil.Process]:
    """Wait for processes to end; return those that did not within the grace."""
    with suppress(psutil.Error, OSError):
        return psutil.wait_procs(processes, timeout=_GRACE_S)[1]
    return processes
