"""One connection of a byte stream: what asyncio calls, in the words of a link."""

import asyncio
from asyncio.trsock import TransportSocket
from collections.abc import Callable
from typing import cast

MOST_WAITING_BYTES = 16_384
"""What waits to be sent beyond this is given up: a setpoint that is late is worse than none."""


class StreamPeer(asyncio.Protocol):
    """The peer of one TCP byte stream.

    received: takes what came and the loop's time. lost: called once, with the reason in words,
    unless we closed it ourselves.
    """

    def __init__(
        self,
        *,
        opened: Callable[["StreamPeer"], None],
        received: Callable[["StreamPeer", bytes, float], None],
        lost: Callable[["StreamPeer", str], None],
    ) -> None:
        self._opened = opened
        self._received = received
        self._lost = lost
        self._transport: asyncio.Transport | None = None
        self._loop = asyncio.get_running_loop()
        self._closed_by_us = False
        self.dropped_writes = 0
        self.heard_s = self._loop.time()
        """When it was last heard, or came."""

    @property
    def address(self) -> str:
        """Return the stream peer's address in messages."""
        if self._transport is None:
            return "nobody"
        host, port = self._transport.get_extra_info("peername")[:2]
        return f"{host}:{port}"

    @property
    def socket(self) -> TransportSocket | None:
        """Return the byte stream's socket; None once it is gone."""
        if self._transport is None:
            return None
        return cast("TransportSocket", self._transport.get_extra_info("socket"))

    def write(self, data: bytes) -> None:
        """Send bytes on the stream, unless it is clogged or gone."""
        transport = self._transport
        if transport is None or transport.is_closing():
            return
        if transport.get_write_buffer_size() > MOST_WAITING_BYTES:
            self.dropped_writes += 1
            return
        transport.write(data)

    def close(self) -> None:
        """Close the byte stream at once; `lost` is not called."""
        self._closed_by_us = True
        if self._transport is not None:
            self._transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the byte stream's transport (asyncio calls this)."""
        self._transport = cast("asyncio.Transport", transport)
        self._opened(self)

    def data_received(self, data: bytes) -> None:
        """Pass the stream's bytes on with their time (asyncio calls this)."""
        self.heard_s = self._loop.time()
        self._received(self, data, self.heard_s)

    def connection_lost(self, exc: Exception | None) -> None:
        """Report why the byte stream ended (asyncio calls this)."""
        self._transport = None
        if self._closed_by_us:
            return
        strerror = exc.strerror if isinstance(exc, OSError) else None
        self._lost(self, "the other side closed it" if exc is None else strerror or str(exc))
