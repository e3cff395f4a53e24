"""One vehicle's MAVLink over the packet socket, as a link: the same at both of its ends."""

import asyncio
from typing import Any, Self

from safety.guard.process.channel import Channel
from safety.guard.process.messages import Bytes
from vehicles.links.link import Receiver


class ChannelLink:
    """A link over the guard's channel to the vehicle at `index`; the owner calls `arrive`.

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
        self._loop: asyncio.AbstractEventLoop | None = None
        """While open."""

    @property
    def name(self) -> str:
        """Return the name of this end of the channel's link."""
        return self._name

    def receive(self, receiver: Receiver) -> None:
        """Set the receiver of bytes that arrive on the channel's link."""
        self._receiver = receiver

    def write(self, data: bytes) -> None:
        """Send bytes over the channel's link; lost when the other end is gone."""
        if self._loop is not None and self.channel is not None:
            self.channel.send(Bytes(self._index, self._loop.time(), data), last=self._last)

    def arrive(self, data: bytes, t_s: float) -> None:
        """Deliver bytes that the channel received for this vehicle's link."""
        if self._loop is not None and self._receiver is not None:
            self._receiver(data, t_s)

    async def __aenter__(self) -> Self:
        """Open this end of the channel's link."""
        self._loop = asyncio.get_running_loop()
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close this end of the channel's link."""
        self._loop = None
