"""The process of a Foxglove bridge: forwards live feeds until standard input closes."""

import contextlib
import math
import os
import select
import socket
import sys
import time
from collections.abc import Callable
from pathlib import Path

from wil_campaign.foundation.processes.codec import ProcessMessageError
from wil_campaign.plugins.console.console_address import ConsoleAddress
from wil_campaign.plugins.console.feed.feed_messages import feed_codec
from wil_campaign.plugins.console.feed.feed_sockets import feed_receiver
from wil_campaign.plugins.console.flight_scope import FlightScope
from wil_campaign.plugins.foxglove.bridge import FoxgloveBridge
from wil_campaign.plugins.foxglove.bridge_address import bridge_address
from wil_campaign.plugins.foxglove.errors import BridgeError
from wil_campaign.plugins.foxglove.foxglove_server import FoxgloveServer

SERVED, REFUSED = "foxglove: ", "refused: "
"""Prefixes of the first line of its output."""
_LONGEST_BYTES = 1 << 18
_NICE = 5
"""The bridge has lower priority than flights on the same cores."""
_LEAVE_S = 0.5
"""Time for the SDK to send the end of the last run."""


def main(arguments: list[str]) -> int:
    """Serve runs in flight to Foxglove; return the exit code.

    arguments: the address, the results folder or empty, and the program's process id or empty.
    """
    address, folder, program = arguments
    scope = FlightScope(
        folder=Path(folder) if folder else None, program=int(program) if program else None
    )
    with contextlib.suppress(OSError):
        os.nice(_NICE)
    try:
        serve_bridge(bridge_address(address), scope, lambda url: print(SERVED + url, flush=True))  # noqa: T201
    except BridgeError as error:
        print(f"{REFUSED}{error}", flush=True)  # noqa: T201 - its parent reads it
        return 2
    return 0


def serve_bridge(
    address: ConsoleAddress, scope: FlightScope, announce: Callable[[str], None]
) -> None:
    """Serve a scope's flights until standard input is closed. Raises BridgeError."""
    with FoxgloveServer(address) as server:
        try:
            with feed_receiver() as end:
                announce(server.url)
                _pass_on(end, scope, FoxgloveBridge(server))
        except OSError as error:
            raise BridgeError(f"live feeds cannot be received: {error}") from error
        time.sleep(_LEAVE_S)


def _pass_on(end: socket.socket, scope: FlightScope, bridge: FoxgloveBridge) -> None:
    """Forward live feeds until standard input is closed, including those received by then."""
    leave_s = math.inf
    while (now_s := time.monotonic()) < leave_s:
        # Nothing is written to stdin: it becomes readable when its other end closes.
        ready, _, _ = select.select([end, sys.stdin], [], [])
        if end in ready:
            with contextlib.suppress(ProcessMessageError, BlockingIOError):
                message = feed_codec.decode(end.recv(_LONGEST_BYTES))
                if scope.covers(message.run):
                    bridge.receive(message, now_s)
        else:
            return
        if sys.stdin in ready:
            leave_s = min(leave_s, now_s + _LEAVE_S)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
