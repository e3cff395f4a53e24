"""Ends a run whose user files hang while they are loaded, with the place where they hang."""

import faulthandler
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from wil_campaign.vehicles.processes.linux import processor_wait_s

LONGEST_LOADING_S = 30.0
_GRACE_S = 5.0
"""After so much more the process ends: the exception was swallowed, or native code hangs."""
_LEAST_S = 0.001
"""A timer set to 0 is off."""


class LoadingTimeoutError(Exception):
    """A run's files were not loaded in time; the traceback shows where they hang."""


@contextmanager
def limited_loading(limit_s: float = LONGEST_LOADING_S) -> Iterator[None]:
    """Raise LoadingTimeoutError in the context when it takes longer; only in the main thread.

    Time for which this process is ready to run but has no processor does not count.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    end_s = time.monotonic() + limit_s - processor_wait_s(os.getpid())
    is_over = False

    def expire(*_: object) -> None:
        if is_over:
            return  # else the process would end in flight, or the rest of the clean-up be skipped
        left_s = end_s + processor_wait_s(os.getpid()) - time.monotonic()
        if left_s > _LEAST_S:
            limit(left_s)
            return
        raise LoadingTimeoutError(
            f"loading the campaign's files took more than {limit_s:g} s: the autonomy or a recipe "
            "step blocks when it is imported or constructed"
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
        is_over = True  # first: an alarm may come between any two of the calls below
        faulthandler.cancel_dump_traceback_later()
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def _has_stderr() -> bool:
    try:
        sys.stderr.fileno()
    except (AttributeError, OSError, ValueError):
        return False
    return True
