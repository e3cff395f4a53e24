"""A Foxglove bridge beside a campaign or a console: a process that neither waits for."""

import os
import select
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from orchestrator.foxglove_bridge.bridge_address import bridge_address
from orchestrator.foxglove_bridge.bridge_process import REFUSED
from orchestrator.foxglove_bridge.errors import BridgeError

_OPEN_S = 30.0
_END_S = 4.0


@contextmanager
def foxglove_beside(address: str, say: Callable[[str], None]) -> Iterator[None]:
    """Have what flies served for Foxglove until the context is left. say: is given where.

    Raises BridgeError before the context is entered.
    """
    bridge_address(address)
    process = subprocess.Popen(  # noqa: S603 - our own interpreter
        [sys.executable, "-m", "orchestrator.foxglove_bridge.bridge_process", address],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
    )
    try:
        line = _first_line(process)
        if not line or line.startswith(REFUSED):
            raise BridgeError(line.removeprefix(REFUSED) or "the Foxglove bridge was not opened")
        say(line)
        yield
    finally:
        _end(process)


def _first_line(process: "subprocess.Popen[bytes]") -> str:
    """Return what a bridge says first; nothing where it ended or takes too long."""
    assert process.stdout is not None  # noqa: S101 - it is a pipe
    data, give_up_s = b"", time.monotonic() + _OPEN_S
    while b"\n" not in data:
        left_s = max(0.0, give_up_s - time.monotonic())
        ready, _, _ = select.select([process.stdout], [], [], left_s)
        more = os.read(process.stdout.fileno(), 4096) if ready else b""
        if not more:
            return ""
        data += more
    return data.decode("utf-8", "replace").strip()


def _end(process: "subprocess.Popen[bytes]") -> None:
    """Let a bridge end; one that does not is killed."""
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
