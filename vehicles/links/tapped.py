"""A link that passes received bytes to taps beside its receiver."""

from wil_campaign.vehicles.links.link import Link, Receiver, TellsUnread, TimesReceiver, WrappedLink


class TappedLink(WrappedLink):
    """A tapped link: passes received bytes to its receiver, and after that to every tap."""

    def __init__(self, link: Link) -> None:
        self._taps: list[Receiver] = []
        super().__init__(link)

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

    def _on_bytes(self, data: bytes, t_s: float) -> None:
        if self._receiver is not None:
            self._receiver(data, t_s)
        for tap in self._taps:
            tap(data, t_s)
