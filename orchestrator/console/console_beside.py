"""A console beside a campaign: a process of its own, so that no page holds up a flight."""

import os
import select
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from orchestrator.console.errors import ConsoleError

LINKS = 2
"""Lines that a console prints once it serves: for the operator, for viewers."""
_OPEN_S = 30.0
_END_S = 8.0


@contextmanager
def console_beside(address: str, say: Callable[[str], None]) -> Iterator[None]:
    """Have a console at an address until the context is left. say: is given its links.

    It outlives a program that dies, until its guards have landed. Raises ConsoleError.
    """
    process = subprocess.Popen(  # noqa: S603 - our own interpreter
        [
            *(sys.executable, "-m", "orchestrator.cli", "console"),
            *("--address", address, "--beside", str(os.getpid())),
        ],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
    )
    try:
        for line in _first_lines(process):
            say(line)
        yield
    finally:
        _end(process)


def _first_lines(process: "subprocess.Popen[bytes]") -> list[str]:
    """Return the lines with which a console tells its links. Raises ConsoleError."""
    assert process.stdout is not None  # noqa: S101 - it is a pipe
    data, give_up_s = b"", time.monotonic() + _OPEN_S
    while data.count(b"\n") < LINKS:
        ready, _, _ = select.select([process.stdout], [], [], give_up_s - time.monotonic())
        more = os.read(process.stdout.fileno(), 4096) if ready else b""
        if not more:
            raise ConsoleError("the console was not opened; nothing flies")
        data += more
    return data.decode("utf-8", "replace").splitlines()


def _end(process: "subprocess.Popen[bytes]") -> None:
    """Let a console end: its pages have shown the last verdict."""
    assert process.stdin is not None  # noqa: S101 - it is a pipe
    with suppress(OSError):
        process.stdin.close()
    try:
        process.wait(_END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stdout is not None:
        process.stdout.close()
