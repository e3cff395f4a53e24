"""Several links as one: ground stations on one port of ours, or a vehicle with two radios."""

from collections.abc import Sequence
from contextlib import AsyncExitStack
from functools import partial
from types import TracebackType
from typing import Self

from vehicles.links.base import Link, Receiver, TellsTrouble
from vehicles.mavlink.framing import Frame, FrameSplitter

_Key = tuple[int, int, int, bytes]
_MOST_REMEMBERED = 4096


class SharedLink:
    """Hands on what comes by any of its links, and writes to all of them.

    Whole MAVLink frames are handed on, so that pieces of different links do not mix. once_s: what
    came by one link and comes by another within so long is the same message and dropped there
    (two radios of one vehicle: each counts its own frames, so that their payloads are compared);
    None keeps all.
    """

    def __init__(self, *, links: Sequence[Link], once_s: float | None = None) -> None:
        if not links:
            raise ValueError("a shared link needs links")
        self._links = tuple(links)
        self._once_s = once_s
        self._receiver: Receiver | None = None
        self._splitters = [FrameSplitter() for _ in self._links]
        self._seen: dict[_Key, tuple[int, float]] = {}
        self._stack = AsyncExitStack()
        self.doubles = 0
        """Frames dropped because another link brought them before."""
        for number, link in enumerate(self._links):
            link.receive(partial(self._received, number))

    @property
    def name(self) -> str:
        """Return the names of the links."""
        return " + ".join(link.name for link in self._links)

    @property
    def trouble(self) -> str:
        """Return the troubles of the links; empty when none has any."""
        troubles = [
            f"{link.name}: {link.trouble}"
            for link in self._links
            if isinstance(link, TellsTrouble) and link.trouble
        ]
        return "; ".join(troubles)

    def receive(self, receiver: Receiver) -> None:
        """Set who is handed what arrives."""
        self._receiver = receiver

    def write(self, data: bytes) -> None:
        """Send bytes by all links."""
        for link in self._links:
            link.write(data)

    async def __aenter__(self) -> Self:
        """Open all links. Raises LinkError when one cannot be had; the others are closed again."""
        async with AsyncExitStack() as stack:
            for link in self._links:
                await stack.enter_async_context(link)
            self._stack = stack.pop_all()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close all links."""
        await self._stack.__aexit__(kind, error, trace)

    def _received(self, number: int, data: bytes, t_s: float) -> None:
        frames = self._splitters[number].feed(data)
        if self._once_s is not None:
            kept = [frame for frame in frames if self._is_first(number, frame, t_s, self._once_s)]
            self.doubles += len(frames) - len(kept)
            frames = kept
        if frames and self._receiver is not None:
            self._receiver(b"".join([frame.raw for frame in frames]), t_s)

    def _is_first(self, number: int, frame: Frame, t_s: float, once_s: float) -> bool:
        key = (frame.system, frame.component, frame.message_id, frame.payload)
        seen = self._seen.get(key)
        if seen is not None and seen[0] != number and t_s - seen[1] <= once_s:
            return False
        self._seen.pop(key, None)
        self._seen[key] = (number, t_s)
        if len(self._seen) > _MOST_REMEMBERED:
            del self._seen[next(iter(self._seen))]
        return True
