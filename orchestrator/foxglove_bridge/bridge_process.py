"""A Foxglove bridge's process: sends live feeds on until standard input closes."""

import contextlib
import math
import os
import select
import socket
import sys
import time
from collections.abc import Callable
from pathlib import Path

from orchestrator.console.console_address import ConsoleAddress
from orchestrator.foxglove_bridge.bridge import Bridge
from orchestrator.foxglove_bridge.bridge_address import bridge_address
from orchestrator.foxglove_bridge.errors import BridgeError
from orchestrator.foxglove_bridge.foxglove_server import FoxgloveServer
from orchestrator.live_feed.feed_messages import feed_codec
from orchestrator.live_feed.feed_sockets import feed_receiver
from orchestrator.operator.flight_scope import FlightScope
from vehicles.processes.codec import MessageError

SERVED, REFUSED = "foxglove: ", "refused: "
"""How the first line of its output begins."""
_LONGEST_BYTES = 1 << 18
_NICE = 5
"""The bridge yields to what flies on the same cores."""
_LEAVE_S = 0.5
"""How long the SDK has to send the end of the last run."""


def main(arguments: list[str]) -> int:
    """Serve at an address the runs of a folder, a program, or all; return the exit code.

    arguments: the address, the folder or nothing, and the program's process or nothing.
    """
    address, folder, program = arguments
    scope = FlightScope(
        folder=Path(folder) if folder else None, program=int(program) if program else None
    )
    with contextlib.suppress(OSError):
        os.nice(_NICE)
    try:
        serve(bridge_address(address), scope, lambda url: print(SERVED + url, flush=True))  # noqa: T201
    except BridgeError as error:
        print(f"{REFUSED}{error}", flush=True)  # noqa: T201 - its parent reads it
        return 2
    return 0


def serve(address: ConsoleAddress, scope: FlightScope, announce: Callable[[str], None]) -> None:
    """Serve a scope's flights until standard input is closed. Raises BridgeError."""
    with FoxgloveServer(address) as server:
        try:
            with feed_receiver() as end:
                announce(server.url)
                _pass_on(end, scope, Bridge(server))
        except OSError as error:
            raise BridgeError(f"live feeds cannot be received: {error}") from error
        time.sleep(_LEAVE_S)


def _pass_on(end: socket.socket, scope: FlightScope, bridge: Bridge) -> None:
    """Pass live feeds on until standard input is closed, and what came of them by then."""
    leave_s = math.inf
    while (now_s := time.monotonic()) < leave_s:
        # Nobody writes to standard input: it can be read once its other end is closed.
        ready, _, _ = select.select([end, sys.stdin], [], [])
        if end in ready:
            with contextlib.suppress(MessageError, BlockingIOError):
                message = feed_codec.decode(end.recv(_LONGEST_BYTES))
                if scope.covers(message.run):
                    bridge.take(message, now_s)
        else:
            return
        if sys.stdin in ready:
            leave_s = min(leave_s, now_s + _LEAVE_S)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
