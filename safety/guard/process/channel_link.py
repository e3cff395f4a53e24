"""One vehicle's MAVLink over the packet socket, as a link: the same at both of its ends."""

import asyncio
from types import TracebackType
from typing import Any, Self

from safety.guard.process.channel import Channel
from safety.guard.process.messages import Bytes
from vehicles.links.link import Receiver


class ChannelLink:
    """The link of the vehicle at `index`; the channel's owner calls `arrive`.

    last: positions that wait go before frames, which are limited by them.
    """

    def __init__(
        self, *, name: str, index: int, channel: Channel[Any] | None = None, last: bool = False
    ) -> None:
        self._name = name
        self._index = index
        self._last = last
        self.channel = channel
        self._receiver: Receiver | None = None
        self._open = False

    @property
    def name(self) -> str:
        """Return the name of this end."""
        return self._name

    def receive(self, receiver: Receiver) -> None:
        """Set who is handed what arrives."""
        self._receiver = receiver

    def write(self, data: bytes) -> None:
        """Send bytes to the other end; lost when it is gone."""
        if self._open and self.channel is not None:
            message = Bytes(self._index, asyncio.get_running_loop().time(), data)
            self.channel.send(message, last=self._last)

    def arrive(self, data: bytes, t_s: float) -> None:
        """Hand on what came for this vehicle."""
        if self._open and self._receiver is not None:
            self._receiver(data, t_s)

    async def __aenter__(self) -> Self:
        """Open this end."""
        self._open = True
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close this end."""
        self._open = False
