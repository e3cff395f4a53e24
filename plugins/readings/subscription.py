"""Takes a ZeroMQ subscription's messages in turns of the loop. Wall clock only."""

import asyncio
from collections.abc import Callable

import zmq

_TURN_S = 0.01
"""After so long the loop does what else is due: a sender may be quicker than its messages are read,
and would hold up setpoints and commands for as long as it sends."""


class Subscription:
    """Calls `take` in the loop with the last part of each message of a connected socket."""

    def __init__(self, socket: "zmq.Socket[bytes]", take: Callable[[bytes, float], None]) -> None:
        self._socket = socket
        self._take = take
        self._loop = asyncio.get_running_loop()
        self._next_turn: asyncio.Handle | None = None

    def start(self) -> None:
        """Begin to take messages, and take those that are there."""
        self._loop.add_reader(self._socket.fileno(), self._read)
        self._read()

    def stop(self) -> None:
        """Take no further message."""
        self._loop.remove_reader(self._socket.fileno())
        if self._next_turn is not None:
            self._next_turn.cancel()

    def _read(self) -> None:
        # The descriptor is edge-triggered: all messages that have arrived must be read.
        if self._next_turn is not None:
            self._next_turn.cancel()
            self._next_turn = None
        until_s = self._loop.time() + _TURN_S
        while self._socket.poll(0, zmq.POLLIN):
            now_s = self._loop.time()
            if now_s > until_s:
                self._next_turn = self._loop.call_soon(self._read)
                return
            self._take(self._socket.recv_multipart(zmq.NOBLOCK)[-1], now_s)
