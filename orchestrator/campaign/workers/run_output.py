"""Redirects the output of a run's process to a file in the run's folder, of limited size."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from wil_campaign.foundation.processes.limited_log import limited_log

OUTPUT_FILE = "output.txt"
_TAIL_BYTES = 4096


@contextmanager
def redirected_run_output(folder: Path) -> Iterator[None]:
    """Write the process's output to the run's folder while in the context; no output, no file.

    This covers file descriptors 1 and 2: the user's autonomy and steps, their children, and
    libraries. Raises OSError.
    """
    path = folder / OUTPUT_FILE
    with limited_log(path) as file:
        before = [os.dup(number) for number in (1, 2)]
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
    with suppress(OSError):  # somebody may have removed it
        if path.stat().st_size == 0:
            path.unlink()


def run_output_tail(folder: Path, lines: int) -> list[str]:
    """Return the last lines of a run's output; empty without any."""
    try:
        with (folder / OUTPUT_FILE).open("rb") as file:
            file.seek(0, os.SEEK_END)
            file.seek(max(0, file.tell() - _TAIL_BYTES))
            return file.read().decode("utf-8", "replace").splitlines()[-lines:]
    except OSError:
        return []


def _flush() -> None:
    """Flush Python's buffers of both streams; on a full disk that output is lost."""
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            with suppress(OSError, ValueError):
                stream.flush()
