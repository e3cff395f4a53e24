"""Files of the user's that hang while they are loaded end their run soon, and say where."""

import faulthandler
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from vehicles.processes.linux import processor_wait_s

LONGEST_LOADING_S = 30.0
_GRACE_S = 5.0
"""After which the process ends, where what is raised is swallowed, or no Python runs at all."""
_LEAST_S = 0.001
"""A timer set to 0 is off."""


class LoadingTimeoutError(Exception):
    """The files that a run names were not loaded in time; its traceback says where they hang."""


@contextmanager
def limited_loading(limit_s: float = LONGEST_LOADING_S) -> Iterator[None]:
    """Raise LoadingTimeoutError within this when it takes longer. Only in a main thread.

    Time for which this process is ready to run but has no processor does not count.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    end_s = time.monotonic() + limit_s - processor_wait_s(os.getpid())

    def expire(*_: object) -> None:
        left_s = end_s + processor_wait_s(os.getpid()) - time.monotonic()
        if left_s > _LEAST_S:
            limit(left_s)
            return
        raise LoadingTimeoutError(
            f"the campaign's files are not loaded within {limit_s:g} s: the autonomy, or a step of "
            "the recipe, blocks when it is imported or built"
        )

    def limit(left_s: float) -> None:
        signal.setitimer(signal.ITIMER_REAL, left_s)
        if _has_stderr():
            faulthandler.dump_traceback_later(left_s + _GRACE_S, exit=True)

    before = signal.signal(signal.SIGALRM, expire)
    limit(limit_s)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def _has_stderr() -> bool:
    """Return whether there is a standard error that faulthandler can write to."""
    try:
        sys.stderr.fileno()
    except (AttributeError, OSError, ValueError):
        return False
    return True
