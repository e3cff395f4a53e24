"""The protocol of byte links: bytes out, bytes in with their time, open and close."""

from collections.abc import Callable, Sequence
from typing import Protocol, Self, runtime_checkable

from wil_campaign.vehicles.errors import VehicleError

Receiver = Callable[[bytes, float], None]
"""Takes whole datagrams or pieces of a stream, and the run clock's time of arrival."""

TimesReceiver = Callable[[Sequence[float]], None]
"""Takes times of the run clock, oldest first."""


class LinkError(VehicleError):
    """A link cannot be opened, or was lost; says which and what to do."""


class Link(Protocol):
    """One end of a byte link to a vehicle; an async context manager.

    `write` never blocks and never raises for an absent peer (nothing is received then); bytes
    arrive by the receiver given to `receive`, called from the event loop.
    """

    @property
    def name(self) -> str:
        """Return the link's name in messages ("udpin://127.0.0.1:14540")."""

    def receive(self, receiver: Receiver) -> None:
        """Set the link's receiver of bytes; called once, before opening."""

    def write(self, data: bytes) -> None:
        """Send bytes on the link."""

    async def __aenter__(self) -> Self:
        """Open the link. Raises LinkError."""

    async def __aexit__(self, *raised: object) -> None:
        """Close the link; nothing arrives afterwards."""


@runtime_checkable
class TellsTrouble(Protocol):
    """A link that knows its operating system's last error."""

    @property
    def trouble(self) -> str:
        """Return the link's last error in words; empty when there was none."""


@runtime_checkable
class ConfirmsSenders(Protocol):
    """A link with several senders, which is told which of them is authentic."""

    def confirm_sender(self) -> None:
        """Take that the bytes being received have a correct signature; called by the receiver."""


@runtime_checkable
class TellsUnread(Protocol):
    """A link that knows when packets arrived that were dropped because they were read too late."""

    def on_unread(self, receiver: TimesReceiver) -> None:
        """Set the receiver of the arrival times of dropped packets."""


class ReceivingLink:
    """The base of links: it has their receiver."""

    _receiver: Receiver | None = None

    def receive(self, receiver: Receiver) -> None:
        """Set the link's receiver of bytes."""
        self._receiver = receiver


class WrappedLink(ReceivingLink):
    """The base of links around another link, whose name, opening and end are theirs."""

    def __init__(self, link: Link) -> None:
        self._link = link
        link.receive(self._on_bytes)

    @property
    def name(self) -> str:
        """Return the wrapped link's name."""
        return self._link.name

    async def __aenter__(self) -> Self:
        """Open the wrapped link. Raises LinkError."""
        await self._link.__aenter__()
        return self

    async def __aexit__(self, *raised: object) -> None:
        """Close the wrapped link."""
        await self._link.__aexit__(*raised)

    def _on_bytes(self, data: bytes, t_s: float) -> None:
        raise NotImplementedError
