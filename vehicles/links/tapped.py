"""A link that passes received bytes to taps beside its receiver."""

from typing import Self

from wil_campaign.vehicles.links.link import Link, Receiver, TellsUnread, TimesReceiver


class TappedLink:
    """A tapped link: passes received bytes to its receiver, and after that to every tap."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._receiver: Receiver | None = None
        self._taps: list[Receiver] = []
        link.receive(self._on_bytes)

    @property
    def name(self) -> str:
        """Return the name of the tapped link."""
        return self._link.name

    def receive(self, receiver: Receiver) -> None:
        """Set the first receiver of the tapped link."""
        self._receiver = receiver

    def tap(self, receiver: Receiver) -> None:
        """Add a tap: `receiver` gets all bytes that arrive from now on, too."""
        self._taps.append(receiver)

    def on_unread(self, receiver: TimesReceiver) -> None:
        """Set the receiver of the arrival times of dropped packets, if the link knows them."""
        if isinstance(self._link, TellsUnread):
            self._link.on_unread(receiver)

    def write(self, data: bytes) -> None:
        """Send bytes on the tapped link."""
        self._link.write(data)

    async def __aenter__(self) -> Self:
        """Open the tapped link. Raises LinkError."""
        await self._link.__aenter__()
        return self

    async def __aexit__(self, *raised: object) -> None:
        """Close the tapped link."""
        await self._link.__aexit__(*raised)

    def _on_bytes(self, data: bytes, t_s: float) -> None:
        if self._receiver is not None:
            self._receiver(data, t_s)
        for tap in self._taps:
            tap(data, t_s)
