"""Calls functions in processes beside this one, which end with it, with Ctrl-C, and when lost."""

import os
import signal
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing import connection, parent_process
from multiprocessing.context import BaseContext
from typing import Any, TypeVar

from wil_campaign.foundation.processes.interrupts import ctrl_c_blocked

Result = TypeVar("Result")
Call = tuple[Callable[..., Result], tuple[Any, ...]]
"""A function and its arguments; both are picklable."""


def call_in_processes(
    calls: Sequence[Call[Result]], workers: int, context: BaseContext
) -> list[Result]:
    """Return what each call returned, in their order. workers: the number of processes.

    Raises BrokenProcessPool where a process is lost, as for lack of memory, and OSError where none
    can be had, as without a writable /dev/shm. The processes are gone then, as after Ctrl-C.
    """
    with ProcessPoolExecutor(workers, mp_context=context, initializer=end_with_program) as pool:
        try:
            with ctrl_c_blocked():  # the first submission starts the processes
                pending: list[Future[Result]] = [pool.submit(*_unpacked(call)) for call in calls]
            # No future is cancelled: the pool's thread would fail at it, and the pool not end.
            return [each.result() for each in pending]
        except BaseException:
            _end_processes(pool)
            raise


def _unpacked(call: Call[Result]) -> tuple[Any, ...]:
    function, arguments = call
    return (function, *arguments)


def _end_processes(pool: ProcessPoolExecutor) -> None:
    """Kill a pool's processes, and let go of what nobody reads: the pool would wait for it."""
    fields = vars(pool)
    for process in tuple((fields["_processes"] or {}).values()):
        process.kill()
    if (queue := fields["_call_queue"]) is not None:
        queue._reader.close()  # noqa: SLF001 - as Python 3.13 does


def end_with_program() -> None:
    """Have signals, and the end of the program that it works for, end this process of a pool.

    One that was forked from the run server ignores signals, and each waits for work that the
    program no longer gives once it is killed.
    """
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
    program = parent_process()
    if program is not None:
        ended = program.sentinel
        threading.Thread(
            target=lambda: connection.wait([ended]) and os._exit(1), daemon=True
        ).start()
