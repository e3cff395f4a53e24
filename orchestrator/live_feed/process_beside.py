"""A process beside a campaign that shows it to somebody; neither waits for the other."""

import os
import select
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

_OPEN_S = 30.0


@contextmanager
def process_beside(arguments: Sequence[str], *, lines: int, end_s: float) -> Iterator[list[str]]:
    """Have a process of our interpreter until the context is left; yield its first lines.

    arguments: of the interpreter. lines: how many it prints once it serves; fewer are yielded where
    it ended, or took 30 s. end_s: how long it may take to end once its standard input is closed; it
    is killed then. Ctrl-C in the terminal is not for it.
    """
    process = subprocess.Popen(  # noqa: S603 - our own interpreter
        [sys.executable, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
    )
    try:
        yield _first_lines(process, lines)
    finally:
        _end(process, end_s)


def _first_lines(process: "subprocess.Popen[bytes]", count: int) -> list[str]:
    """Return the process's first lines, or what came of them."""
    assert process.stdout is not None  # noqa: S101 - it is a pipe
    data, give_up_s = b"", time.monotonic() + _OPEN_S
    while data.count(b"\n") < count:
        left_s = max(0.0, give_up_s - time.monotonic())
        ready, _, _ = select.select([process.stdout], [], [], left_s)
        more = os.read(process.stdout.fileno(), 4096) if ready else b""
        if not more:
            break
        data += more
    return data.decode("utf-8", "replace").splitlines()


def _end(process: "subprocess.Popen[bytes]", end_s: float) -> None:
    """Let the process end by itself; one that does not is killed."""
    assert process.stdin is not None  # noqa: S101 - it is a pipe
    with suppress(OSError):
        process.stdin.close()
    try:
        process.wait(end_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stdout is not None:
        process.stdout.close()
