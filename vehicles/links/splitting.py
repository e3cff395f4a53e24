"""One link for several: a driver, a recorder and a ground station on the same vehicle."""

from types import TracebackType
from typing import Self

from vehicles.links.link import Link, Receiver, TellsTrouble
from vehicles.mavlink.framing import FrameSplitter


class LinkSplitter:
    """Gives a vehicle's link to several users; an async context manager that opens and closes it.

    Each `end` hears all that comes. What ends write is sent in whole MAVLink frames, so that
    pieces of theirs do not mix. An end that is closed hears nothing, and what it writes is lost.
    """

    def __init__(self, *, link: Link) -> None:
        self._link = link
        self._ends: list[LinkEnd] = []
        link.receive(self._on_bytes)

    def end(self, name: str) -> "LinkEnd":
        """Return one more end of the link."""
        end = LinkEnd(name=f"{self._link.name} ({name})", link=self._link)
        self._ends.append(end)
        return end

    async def __aenter__(self) -> Self:
        """Open the link. Raises LinkError."""
        await self._link.__aenter__()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the link."""
        await self._link.__aexit__(kind, error, trace)

    def _on_bytes(self, data: bytes, t_s: float) -> None:
        for end in self._ends:
            end.hear(data, t_s)


class LinkEnd:
    """One user's end of a split link; opening and closing it leaves the link itself alone."""

    def __init__(self, *, name: str, link: Link) -> None:
        self._name = name
        self._link = link
        self._receiver: Receiver | None = None
        self._splitter = FrameSplitter()
        self._open = False

    @property
    def name(self) -> str:
        """Return the link's name and the user's."""
        return self._name

    @property
    def trouble(self) -> str:
        """Return the link's trouble."""
        return self._link.trouble if isinstance(self._link, TellsTrouble) else ""

    def receive(self, receiver: Receiver) -> None:
        """Set who is handed what arrives."""
        self._receiver = receiver

    def write(self, data: bytes) -> None:
        """Send the frames that are whole now."""
        if not self._open:
            return
        if whole := b"".join([frame.raw for frame in self._splitter.feed(data)]):
            self._link.write(whole)

    def hear(self, data: bytes, t_s: float) -> None:
        """Take what came by the link."""
        if self._open and self._receiver is not None:
            self._receiver(data, t_s)

    async def __aenter__(self) -> Self:
        """Begin to hear."""
        self._open = True
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Hear no more."""
        self._open = False


class Bridge:
    """Passes all that comes by one link to the other, both ways; opens and closes both.

    Between a ground station's port and the `end` of a split link.
    """

    def __init__(self, *, one: Link, other: Link) -> None:
        self._one = one
        self._other = other
        one.receive(lambda data, _: other.write(data))
        other.receive(lambda data, _: one.write(data))

    async def __aenter__(self) -> Self:
        """Open both. Raises LinkError; then neither is open."""
        await self._one.__aenter__()
        try:
            await self._other.__aenter__()
        except BaseException as error:
            await self._one.__aexit__(type(error), error, error.__traceback__)
            raise
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close both."""
        try:
            await self._other.__aexit__(kind, error, trace)
        finally:
            await self._one.__aexit__(kind, error, trace)
