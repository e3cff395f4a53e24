"""What a run's process prints goes to a file of the run's folder, and is bounded there."""

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

OUTPUT_FILE = "output.txt"
_MOST_BYTES = 16_000_000
_LOOK_S = 0.25
_TAIL_BYTES = 4096


@contextmanager
def kept_output(folder: Path) -> Iterator[None]:
    """Write what this process prints within this to the run's folder; without any: no file.

    That is the user's autonomy and steps, their children, and libraries: file descriptors 1 and 2.
    Beyond 16 MB the newest is dropped. Raises OSError.
    """
    path = folder / OUTPUT_FILE
    file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    before = [os.dup(number) for number in (1, 2)]
    over = threading.Event()
    bound = threading.Thread(target=_bound, args=(file, over), name="output", daemon=True)
    bound.start()
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
        bound.join()
        empty = os.fstat(file).st_size == 0
        os.close(file)
        if empty:
            path.unlink(missing_ok=True)


def output_tail(folder: Path, lines: int) -> list[str]:
    """Return the last lines that a run's process printed."""
    try:
        with (folder / OUTPUT_FILE).open("rb") as file:
            file.seek(0, os.SEEK_END)
            file.seek(max(0, file.tell() - _TAIL_BYTES))
            return file.read().decode("utf-8", "replace").splitlines()[-lines:]
    except OSError:
        return []


def _bound(file: int, over: threading.Event) -> None:
    """Cut a run's output file to its most bytes, whenever it has become longer."""
    while not over.wait(_LOOK_S):
        _cut(file)
    _cut(file)


def _cut(file: int) -> None:
    if os.fstat(file).st_size > _MOST_BYTES:
        os.ftruncate(file, _MOST_BYTES)


def _flush() -> None:
    """Write what Python still holds of both streams; a full disk loses it, and never a result."""
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            with suppress(OSError, ValueError):
                stream.flush()
