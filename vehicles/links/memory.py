"""A link in memory: two ends, a fixed latency, in order; for virtual time."""

import asyncio
from collections import deque
from typing import Self

from wil_campaign.vehicles.links.link import Link, LinkError, ReceivingLink


class MemoryLink(ReceivingLink):
    """One end of a link in memory; written bytes arrive at the other end `latency_s` later.

    Bytes written while either end is closed are lost, as on a cable that is not plugged in.
    """

    def __init__(self, *, name: str, latency_s: float) -> None:
        self._name = name
        self._latency_s = latency_s
        self._other: MemoryLink | None = None
        self._under_way: deque[tuple[float, bytes]] = deque()
        self._timer: asyncio.Handle | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        """The running loop while open: get_running_loop costs as much as handing on a packet."""

    @property
    def name(self) -> str:
        """Return the name of this end of the memory link."""
        return self._name

    def write(self, data: bytes) -> None:
        """Send bytes to the memory link's other end."""
        if self._loop is not None and self._other is not None:
            self._other._take(data)  # noqa: SLF001 - the twin end

    async def __aenter__(self) -> Self:
        """Open this end of the memory link."""
        self._loop = asyncio.get_running_loop()
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close this end of the memory link; delayed bytes to it are lost."""
        self._loop = None
        self._under_way.clear()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def join(self, other: "MemoryLink") -> None:
        """Join this end of the memory link to `other`, which receives from it."""
        self._other = other

    def _take(self, data: bytes) -> None:
        loop = self._loop
        if loop is None:
            return
        self._under_way.append((loop.time() + self._latency_s, data))
        if self._timer is None:
            self._arm(loop)

    def _arm(self, loop: asyncio.AbstractEventLoop) -> None:
        # One timer for the queue: timers of one instant have no order among themselves.
        due_s = self._under_way[0][0]
        if due_s <= loop.time():
            self._timer = loop.call_soon(self._deliver)
        else:
            self._timer = loop.call_at(due_s, self._deliver)

    def _deliver(self) -> None:
        loop, self._timer = self._loop, None
        if loop is None:
            return
        now_s = loop.time()
        arrived: list[bytes] = []
        while self._under_way and self._under_way[0][0] <= now_s:
            arrived.append(self._under_way.popleft()[1])
        if self._under_way:
            self._arm(loop)
        if self._receiver is not None:
            for data in arrived:
                self._receiver(data, now_s)


def memory_pair(*, latency_s: float = 0.0, name: str = "memory") -> tuple[Link, Link]:
    """Return the two ends of a link in memory, with `latency_s` each way.

    With no latency bytes arrive in the next turn of the event loop, at the same time. Raises
    ValueError for a latency below zero.
    """
    if not latency_s >= 0.0:
        raise ValueError(f"latency_s is {latency_s}: it must be 0 s or more")
    first = MemoryLink(name=f"{name}:a", latency_s=latency_s)
    second = MemoryLink(name=f"{name}:b", latency_s=latency_s)
    first.join(second)
    second.join(first)
    return first, second


def refuse(_: object) -> Link:
    """Refuse to open one end of a memory link alone. Raises LinkError."""
    raise LinkError("memory:// links have both ends in one process; memory_pair() creates both")
