"""Calls that need a disk, which may stand still: nobody waits for one for ever."""

import asyncio
import contextlib
import errno
import threading
from collections.abc import Callable
from concurrent.futures import Future, wait
from functools import partial
from pathlib import Path
from typing import TypeVar

from wil_campaign.foundation.tasks import finish_in_task

T = TypeVar("T")

_POLL_S = 0.05
_MOST_POLLS = 240
"""Of our own turns, not of time, as at the end of a file: 12 s (foundation/background_file.py)."""


async def access_disk(
    call: Callable[[], T], *, name: str, late: Callable[[T], object] | None = None
) -> T:
    """Return the result of a call in a thread, whatever happens to the caller meanwhile.

    late: called in the thread with a result that nobody waits for any more. Raises what the call
    raises, and TimeoutError, an OSError, where the disk takes nothing for 12 s.
    """
    return await finish_in_task(asyncio.to_thread(partial(_result, call, name, late)), name=name)


async def remove_backup(path: Path, remove: Callable[[], None], *, name: str) -> str:
    """Remove a backup file; return in words why it is left, empty where it is not."""
    try:
        await access_disk(remove, name=name)
    except OSError as error:
        return f"backup {path} cannot be removed ({error.strerror}); remove it"
    return ""


def _result(call: Callable[[], T], name: str, late: Callable[[T], object] | None) -> T:
    """Return the result of a call in a daemon thread, which may never end."""
    future: Future[T] = Future()

    def work() -> None:
        try:
            result = call()
        except BaseException as error:  # noqa: BLE001  # raised where it is waited for
            if future.set_running_or_notify_cancel():
                future.set_exception(error)
            return
        if future.set_running_or_notify_cancel():
            future.set_result(result)
        elif late is not None:
            with contextlib.suppress(OSError):
                late(result)

    threading.Thread(target=work, name=name, daemon=True).start()
    for _ in range(_MOST_POLLS):
        if wait([future], _POLL_S).done:
            break
    if future.cancel():
        raise TimeoutError(errno.ETIMEDOUT, "the disk takes nothing")
    return future.result()
