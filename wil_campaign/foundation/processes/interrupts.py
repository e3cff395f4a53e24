"""Signals: what a program's loop does with them, and Ctrl-C kept from the program's helpers."""

import asyncio
import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from multiprocessing import resource_tracker


@contextmanager
def ctrl_c_blocked() -> Iterator[None]:
    """Block Ctrl-C in this thread, and so in each process that it starts meanwhile, for good.

    A process of `multiprocessing` that Ctrl-C ends prints a traceback, also while it imports. Its
    program gets the signal when the context ends, and ends it.
    """
    resource_tracker.ensure_running()  # starting it unblocks the signal
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def ignore_ctrl_c() -> None:
    """Ignore Ctrl-C in this process and in those that it starts, also where it was blocked."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


@contextmanager
def signals_call(calls: Mapping[signal.Signals, Callable[[], object]]) -> Iterator[None]:
    """Have the running loop call a function for each signal that is not ignored.

    What a signal did before it does again at the end: asyncio alone would leave SIGTERM and SIGHUP
    to kill the program from then on, whatever its own code had them do.
    """
    loop = asyncio.get_running_loop()
    before = {number: signal.getsignal(number) for number in calls}
    called = [number for number, handler in before.items() if handler is not signal.SIG_IGN]
    for number in called:
        loop.add_signal_handler(number, calls[number])
    try:
        yield
    finally:
        for number in called:
            loop.remove_signal_handler(number)
            if (handler := before[number]) is not None:  # None: one that is not Python's
                signal.signal(number, handler)
