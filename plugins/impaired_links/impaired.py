"""A link with a simulated bad radio: frames are lost, delayed, doubled or corrupted."""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from wil_campaign.plugins.impaired_links.impairment import (
    ImpairedDirection,
    Impairment,
    ImpairmentCounts,
)
from wil_campaign.vehicles.links.link import Link, TellsTrouble, WrappedLink
from wil_campaign.vehicles.links.link_conditions import LinkLayer, LinkSite
from wil_campaign.vehicles.mavlink.framing import FrameSplitter


@dataclass(frozen=True, kw_only=True)
class Radio(LinkLayer):
    """A simulated radio: impairs the preferred link of a vehicle, not its spare ones.

    outgoing, incoming: the impairment of each direction. seed: of its random numbers.
    """

    name: str = "links"
    outgoing: Impairment
    incoming: Impairment
    seed: tuple[int, ...]

    def over(self, links: Sequence[Link], _: LinkSite) -> list[Link]:
        """Return the links, the first impaired."""
        rng = np.random.default_rng(list(self.seed))
        first = ImpairedLink(link=links[0], outgoing=self.outgoing, incoming=self.incoming, rng=rng)
        return [first, *links[1:]]


class ImpairedLink(WrappedLink):
    """An impaired link: MAVLink frames are lost, delayed, doubled and corrupted independently.

    outgoing: the impairment of written frames; incoming: of received ones. rng: a generator of its
    own; the same seed and the same frames at the same times give the same arrivals.
    """

    def __init__(
        self,
        *,
        link: Link,
        outgoing: Impairment,
        incoming: Impairment,
        rng: np.random.Generator,
    ) -> None:
        out_rng, in_rng = rng.spawn(2)
        self._out = _TimedDirection(outgoing, out_rng, self._send)
        self._in = _TimedDirection(incoming, in_rng, self._hand_on)
        super().__init__(link)

    @property
    def trouble(self) -> str:
        """Return the impaired link's own trouble."""
        return self._link.trouble if isinstance(self._link, TellsTrouble) else ""

    @property
    def outgoing(self) -> ImpairmentCounts:
        """Return the counts of frames sent on the impaired link."""
        return self._out.counts

    @property
    def incoming(self) -> ImpairmentCounts:
        """Return the counts of frames received on the impaired link."""
        return self._in.counts

    def write(self, data: bytes) -> None:
        """Send frames through the impairment."""
        self._out.put(data)

    def start_outage(self, duration_s: float) -> None:
        """Start an outage of the impaired link, both ways, for a while."""
        self._out.start_outage(duration_s)
        self._in.start_outage(duration_s)

    async def __aenter__(self) -> Self:
        """Open the wrapped link; outages count from here. Raises LinkError."""
        self._out.open()
        self._in.open()
        return await super().__aenter__()

    async def __aexit__(self, *raised: object) -> None:
        """Close the wrapped link; delayed frames are lost."""
        self._out.close()
        self._in.close()
        await super().__aexit__(*raised)

    def _on_bytes(self, data: bytes, _t_s: float) -> None:
        self._in.put(data)

    def _send(self, frames: list[bytes], _t_s: float) -> None:
        self._link.write(b"".join(frames))

    def _hand_on(self, frames: list[bytes], t_s: float) -> None:
        if self._receiver is not None:
            self._receiver(b"".join(frames), t_s)


class _TimedDirection:
    """One direction of an impaired link, with the timer of its next arrival."""

    def __init__(
        self,
        impairment: Impairment,
        rng: np.random.Generator,
        deliver: Callable[[list[bytes], float], None],
    ) -> None:
        self._impairment = impairment
        self._rng = rng
        self._deliver = deliver
        self._splitter = FrameSplitter()
        self._direction: ImpairedDirection | None = None
        self._open = False
        self._timer: asyncio.TimerHandle | None = None

    @property
    def counts(self) -> ImpairmentCounts:
        """Return the impaired direction's counts; zeros before the link is opened."""
        return ImpairmentCounts() if self._direction is None else self._direction.counts

    def open(self) -> None:
        now_s = asyncio.get_running_loop().time()
        self._direction = ImpairedDirection(
            impairment=self._impairment, rng=self._rng, opened_s=now_s
        )
        self._open = True

    def close(self) -> None:
        """Close the impaired direction; delayed frames are lost."""
        self._open = False
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def start_outage(self, duration_s: float) -> None:
        if self._direction is not None:
            self._direction.start_outage(asyncio.get_running_loop().time(), duration_s)

    def put(self, data: bytes) -> None:
        """Take bytes sent now into the impaired direction."""
        direction = self._direction
        if direction is None or not self._open:
            return
        now_s = asyncio.get_running_loop().time()
        for frame in self._splitter.feed(data):
            direction.put(frame.raw, now_s)
        self._deliver_due(now_s)

    def _tick(self) -> None:
        """Deliver impaired frames that are due, and set the next timer."""
        self._timer = None
        self._deliver_due(asyncio.get_running_loop().time())

    def _deliver_due(self, now_s: float) -> None:
        """Deliver the impaired frames that have arrived by now."""
        direction = self._direction
        if direction is None:
            return
        arrived = direction.take(now_s)
        due_s = direction.next_due_s
        if due_s is not None and (self._timer is None or due_s < self._timer.when()):
            if self._timer is not None:
                self._timer.cancel()
            self._timer = asyncio.get_running_loop().call_at(due_s, self._tick)
        if arrived:
            self._deliver(arrived, now_s)
