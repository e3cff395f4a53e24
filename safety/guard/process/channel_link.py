"""One vehicle's MAVLink over the packet socket, as a link: the same at both of its ends."""

import asyncio
from collections.abc import Sequence
from typing import Any, Self

from wil_campaign.foundation.processes.codec import ProcessMessage
from wil_campaign.safety.guard.process.channel import LONGEST_PACKET_BYTES, GuardChannel
from wil_campaign.safety.guard.process.messages import FrameBytes, UnreadBytes
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget
from wil_campaign.vehicles.driver.session.arrivals import Arrivals
from wil_campaign.vehicles.links.link import ReceivingLink, TimesReceiver
from wil_campaign.vehicles.mavlink.framing import FrameSplitter

_LONGEST_BYTES = LONGEST_PACKET_BYTES // 2
"""Of one message; what a link hands over beyond it at once goes in parts."""


class ChannelLink(ReceivingLink):
    """A link over the guard's channel to the vehicle at `index`; the owner calls `arrive`.

    last: positions that wait go before frames, which are limited by them. target: the vehicle of
    whose frames the other end is to know when it did not read them in time.
    """

    def __init__(
        self,
        *,
        name: str,
        index: int,
        channel: GuardChannel[Any] | None = None,
        last: bool = False,
        target: MavlinkTarget | None = None,
    ) -> None:
        self._name = name
        self._index = index
        self._last = last
        self._target = target
        self._lost_arrivals = Arrivals()
        self._lost_count = 0
        self.channel = channel
        self._unread_receiver: TimesReceiver | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        """While open."""

    @property
    def name(self) -> str:
        """Return the name of this end of the channel's link."""
        return self._name

    def write(self, data: bytes) -> None:
        """Send bytes over the channel's link; lost when the other end is gone."""
        if self._loop is not None and self.channel is not None:
            if self._lost_count and not self.channel.congested:
                count, self._lost_count = self._lost_count, 0
                self.channel.send(UnreadBytes(self._index, self._lost_arrivals.take(), count))
            for begin in range(0, len(data), _LONGEST_BYTES):
                part = data[begin : begin + _LONGEST_BYTES]
                self.channel.send(FrameBytes(self._index, self._loop.time(), part), last=self._last)

    def _lose(self, lost: ProcessMessage) -> None:
        """Note bytes that the other end did not read in time."""
        if not isinstance(lost, FrameBytes) or lost.index != self._index:
            return
        self._lost_count += 1
        frames = FrameSplitter().feed(lost.data)
        if any(MavlinkTarget(each.system, each.component) == self._target for each in frames):
            self._lost_arrivals.note(lost.t_s)

    def arrive(self, data: bytes, t_s: float) -> None:
        """Deliver bytes that the channel received for this vehicle's link."""
        if self._loop is not None and self._receiver is not None:
            self._receiver(data, t_s)

    def on_unread(self, receiver: TimesReceiver) -> None:
        """Set the receiver of the arrival times of bytes of the vehicle that were lost."""
        self._unread_receiver = receiver

    def arrived_unread(self, arrived_s: Sequence[float]) -> None:
        """Deliver the times of bytes for this vehicle's link that were lost on the channel."""
        if self._loop is not None and self._unread_receiver is not None:
            self._unread_receiver(arrived_s)

    async def __aenter__(self) -> Self:
        """Open this end of the channel's link."""
        self._loop = asyncio.get_running_loop()
        if self._target is not None and self.channel is not None:
            self.channel.on_lost(self._lose)
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close this end of the channel's link."""
        self._loop = None
