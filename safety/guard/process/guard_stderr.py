"""guard.stderr: what a guard's process printed before it died."""

import contextlib
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from logging.handlers import QueueHandler
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import IO, TextIO

from wil_campaign.foundation.processes.linux import raise_process_priority

_NAME = "guard.stderr"
_LONGEST = 2000
_POLL_S = 0.05
_MOST_POLLS = 20
"""1 s of our own turns that its end waits for the disk, after the 12 s for the guard's files."""


def open_stderr(folder: str) -> IO[bytes]:
    """Return the file for the guard's stderr in its run's folder. Raises OSError."""
    return (Path(folder) / _NAME).open("w+b")


@contextmanager
def logging_in_thread() -> Iterator[None]:
    """Have a thread write this process's log records to stderr, which is a file on a disk."""
    records: SimpleQueue[logging.LogRecord | None] = SimpleQueue()
    handler = QueueHandler(records)
    stream = open(  # noqa: SIM115  # a dead disk holds it for ever
        sys.stderr.fileno(), "w", encoding="utf-8", errors="backslashreplace", closefd=False
    )
    thread = Thread(target=_write, args=(records, stream), name=f"writer {_NAME}", daemon=True)
    logging.getLogger().addHandler(handler)
    thread.start()
    try:
        yield
    finally:
        logging.getLogger().removeHandler(handler)
        records.put(None)
        for _ in range(_MOST_POLLS):
            if not thread.is_alive():
                break
            thread.join(_POLL_S)


def _write(records: "SimpleQueue[logging.LogRecord | None]", stream: TextIO) -> None:
    """Write log records until the end, with the guard's priority (see `guard_file`).

    Not by a log handler, nor to sys.stderr: a process that ends waits for the locks of both.
    """
    raise_process_priority()
    while (record := records.get()) is not None:
        with contextlib.suppress(OSError):
            print(record.getMessage(), file=stream, flush=True)


def guard_stderr_tail(folder: str) -> str:
    """Return that the guard ended, with the last lines of its stderr."""
    words = ""
    with contextlib.suppress(OSError):
        words = (Path(folder) / _NAME).read_text(encoding="utf-8")
    return f"the guard's process ended: {words[-_LONGEST:].strip() or 'it printed nothing'}"


def remove_empty_stderr(folder: str) -> None:
    """Remove the guard's stderr file if it is empty."""
    path = Path(folder) / _NAME
    with contextlib.suppress(OSError):
        if path.stat().st_size == 0:
            path.unlink()
