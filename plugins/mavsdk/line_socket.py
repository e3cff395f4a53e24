"""The driver's socket to a mavsdk process: writes and reads whole messages without waiting."""

import asyncio
import socket
from collections.abc import Callable
from typing import Self, cast

from wil_campaign.plugins.mavsdk.messages import FromProcess, ToProcess, from_process, to_process
from wil_campaign.vehicles.processes.codec import FrameReader, MessageError, framed

_LONGEST_QUEUE_BYTES = 4 << 20
"""A process that does not read counts as hung long before; a mission of thousands fits in."""


class LineSocket(asyncio.Protocol):
    """A socket of messages: writes them, and passes received ones on; `garbage`: unreadable."""

    def __init__(self, on_message: Callable[[FromProcess], None]) -> None:
        self._on_message = on_message
        self._frames = FrameReader()
        self._transport: asyncio.Transport | None = None
        self.garbage = 0

    @classmethod
    async def on(cls, end: socket.socket, on_message: Callable[[FromProcess], None]) -> Self:
        """Return a line socket on this socket, which it closes."""
        loop = asyncio.get_running_loop()
        end.setblocking(False)
        _, lines = await loop.create_connection(lambda: cls(on_message), sock=end)
        return lines

    def write(self, message: ToProcess) -> None:
        """Write a message to the line socket; dropped when the other end is gone or full."""
        transport, frame = self._transport, framed(to_process.encode(message))
        if transport is None or transport.is_closing():
            return
        if transport.get_write_buffer_size() + len(frame) <= _LONGEST_QUEUE_BYTES:
            transport.write(frame)

    def close(self) -> None:
        """Close the line socket."""
        if self._transport is not None:
            self._transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the line socket's transport (asyncio calls this)."""
        self._transport = cast("asyncio.Transport", transport)

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - asyncio's
        """Drop the transport (asyncio calls this); the process's exit is reported elsewhere."""
        self._transport = None

    def data_received(self, data: bytes) -> None:
        """Pass the line socket's whole messages on (asyncio calls this)."""
        for packet in self._frames.feed(data):
            try:
                message = from_process.decode(packet)
            except MessageError:
                self.garbage += 1
                continue
            self._on_message(message)
