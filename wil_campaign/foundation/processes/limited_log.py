"""A file for what programs print: of limited size, with its beginning and its end."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_MOST_BYTES = 16_000_000
_HEAD_BYTES, _TAIL_BYTES = 8_000_000, 1_000_000
_POLL_S = 0.25


@contextmanager
def limited_log(path: Path) -> Iterator[int]:
    """Open a file for the output of programs while in the context: its descriptor, for appending.

    Beyond 16 MB its middle is dropped: what a program prints last tells how it ended. Raises
    OSError.
    """
    file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
    over = threading.Event()
    limiter = threading.Thread(target=_limit_size, args=(file, over), name="output", daemon=True)
    try:
        limiter.start()
        try:
            yield file
        finally:
            over.set()
            limiter.join()
    finally:
        os.close(file)


def _limit_size(file: int, over: threading.Event) -> None:
    """Drop the middle of a file whenever it exceeds its limit, until `over` and once after it."""
    is_over = False
    while not is_over:
        is_over = over.wait(_POLL_S)
        with suppress(OSError):  # of a full disk
            _drop_middle(file)


def _drop_middle(file: int) -> None:
    """Drop the middle of a file that is too large, and what is written to it in that moment."""
    size = os.fstat(file).st_size
    if size <= _MOST_BYTES:
        return
    tail = os.pread(file, _TAIL_BYTES, size - _TAIL_BYTES)
    os.ftruncate(file, _HEAD_BYTES)
    dropped = size - _HEAD_BYTES - len(tail)
    os.write(file, f"\n[{dropped} bytes are left out here]\n".encode() + tail)
