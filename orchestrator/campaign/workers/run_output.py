"""Redirects the output of a run's process to a file in the run's folder, of limited size."""

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

OUTPUT_FILE = "output.txt"
_MAX_BYTES = 16_000_000
_POLL_S = 0.25
_TAIL_BYTES = 4096


@contextmanager
def redirected_run_output(folder: Path) -> Iterator[None]:
    """Write the process's output to the run's folder while in the context; no output, no file.

    This covers file descriptors 1 and 2: the user's autonomy and steps, their children, and
    libraries. Output beyond 16 MB is dropped. Raises OSError.
    """
    path = folder / OUTPUT_FILE
    file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    before = [os.dup(number) for number in (1, 2)]
    over = threading.Event()
    limiter = threading.Thread(target=_limit_size, args=(file, over), name="output", daemon=True)
    limiter.start()
    try:
        _flush()
        for number in (1, 2):
            os.dup2(file, number)
        yield
    finally:
        _flush()
        for number, copy in zip((1, 2), before, strict=True):
            os.dup2(copy, number)
            os.close(copy)
        over.set()
        limiter.join()
        empty = os.fstat(file).st_size == 0
        os.close(file)
        if empty:
            path.unlink(missing_ok=True)


def run_output_tail(folder: Path, lines: int) -> list[str]:
    """Return the last lines of a run's output; empty without any."""
    try:
        with (folder / OUTPUT_FILE).open("rb") as file:
            file.seek(0, os.SEEK_END)
            file.seek(max(0, file.tell() - _TAIL_BYTES))
            return file.read().decode("utf-8", "replace").splitlines()[-lines:]
    except OSError:
        return []


def _limit_size(file: int, over: threading.Event) -> None:
    """Truncate a run's output file to its size limit, whenever it exceeds that."""
    while not over.wait(_POLL_S):
        _truncate(file)
    _truncate(file)


def _truncate(file: int) -> None:
    if os.fstat(file).st_size > _MAX_BYTES:
        os.ftruncate(file, _MAX_BYTES)


def _flush() -> None:
    """Flush Python's buffers of both streams; on a full disk that output is lost."""
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            with suppress(OSError, ValueError):
                stream.flush()
