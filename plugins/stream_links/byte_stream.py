"""The asyncio protocol of one TCP connection of a link."""

import asyncio
from asyncio.trsock import TransportSocket
from collections.abc import Callable
from typing import cast

from wil_campaign.vehicles.links.reads import shorten_reads

MOST_WAITING_BYTES = 16_384
"""Writes beyond so many waiting bytes are dropped: a late setpoint is worse than none."""


class StreamPeer(asyncio.Protocol):
    """The peer of one TCP byte stream.

    received: called with bytes and the loop's time of arrival. on_lost: called once, with the
    reason in words, unless this side closed the connection.
    """

    def __init__(
        self,
        *,
        opened: Callable[["StreamPeer"], None],
        received: Callable[["StreamPeer", bytes, float], None],
        on_lost: Callable[["StreamPeer", str], None],
    ) -> None:
        self._opened = opened
        self._received = received
        self._on_lost = on_lost
        self._transport: asyncio.Transport | None = None
        self._loop = asyncio.get_running_loop()
        self._closed_by_us = False
        self.dropped_writes = 0
        self.last_received_s = self._loop.time()
        """When bytes arrived last, or the connection was made."""

    @property
    def address(self) -> str:
        """Return the stream peer's address in messages."""
        if self._transport is None:
            return "no peer"
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
        """Close the byte stream at once; `on_lost` is not called."""
        self._closed_by_us = True
        if self._transport is not None:
            self._transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the byte stream's transport (asyncio calls this)."""
        shorten_reads(transport)
        self._transport = cast("asyncio.Transport", transport)
        self._opened(self)

    def data_received(self, data: bytes) -> None:
        """Pass the stream's bytes on with their time (asyncio calls this)."""
        self.last_received_s = self._loop.time()
        self._received(self, data, self.last_received_s)

    def connection_lost(self, exc: Exception | None) -> None:
        """Report why the byte stream ended (asyncio calls this)."""
        self._transport = None
        if self._closed_by_us:
            return
        strerror = exc.strerror if isinstance(exc, OSError) else None
        self._on_lost(self, "the peer closed it" if exc is None else strerror or str(exc))
