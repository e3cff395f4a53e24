"""guard.stderr: what a guard's process printed before it died."""

import contextlib
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from logging.handlers import QueueHandler, QueueListener
from pathlib import Path
from queue import SimpleQueue
from typing import IO

from vehicles.processes.linux import rise_above_load

_NAME = "guard.stderr"
_LONGEST = 2000


def open_stderr(folder: str) -> IO[bytes]:
    """Return the file for the guard's stderr in its run's folder. Raises OSError."""
    return (Path(folder) / _NAME).open("w+b")


class _Listener(QueueListener):
    """Writes log records in a thread that has the guard's priority (see `guard_file`)."""

    _has_risen = False

    def dequeue(self, block: bool) -> logging.LogRecord:
        """Return the next record, in the listener's thread."""
        if not self._has_risen:
            self._has_risen = True
            rise_above_load()
        return super().dequeue(block)


@contextmanager
def logging_in_thread() -> Iterator[None]:
    """Have a thread write this process's log records to stderr, which is a file on a disk."""
    records: SimpleQueue[logging.LogRecord] = SimpleQueue()
    handler = QueueHandler(records)
    listener = _Listener(records, logging.StreamHandler(sys.stderr))
    logging.getLogger().addHandler(handler)
    listener.start()
    try:
        yield
    finally:
        logging.getLogger().removeHandler(handler)
        listener.stop()


def guard_stderr_tail(folder: str) -> str:
    """Return that the guard ended, with the last lines of its stderr."""
    words = ""
    with contextlib.suppress(OSError):
        words = (Path(folder) / _NAME).read_text(encoding="utf-8")
    return f"the guard's process ended: {words[-_LONGEST:].strip() or 'it printed nothing'}"


def remove_if_empty(folder: str) -> None:
    """Remove the guard's stderr file if it is empty."""
    path = Path(folder) / _NAME
    with contextlib.suppress(OSError):
        if path.stat().st_size == 0:
            path.unlink()
