"""Runs a helper process, such as a console, beside a campaign that has no event loop yet."""

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
    """Run a process of this interpreter until the context is left; yield its first lines.

    arguments: of the interpreter. lines: the number that it prints once it is ready; fewer are
    yielded if it ended, or after 30 s. end_s: how long it may take to end after its standard input
    is closed, before it is killed. Ctrl-C in the terminal does not reach it.
    """
    with subprocess.Popen(  # noqa: S603 - this interpreter
        [sys.executable, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
    ) as process:
        try:
            yield _first_lines(process, lines)
        finally:
            _end(process, end_s)


def _first_lines(process: "subprocess.Popen[bytes]", count: int) -> list[str]:
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
    """Close the process's standard input; kill it if it does not end in time."""
    assert process.stdin is not None  # noqa: S101 - it is a pipe
    with suppress(OSError):
        process.stdin.close()
    try:
        process.wait(end_s)
    except subprocess.TimeoutExpired:
        process.kill()
