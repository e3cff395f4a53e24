"""Links with MAVLink 2 signing: they sign outgoing frames, and accept only signed ones."""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from wil_campaign.plugins.signed_links.signer import (
    TICKS_PER_S,
    Signer,
    SigningCounts,
    ticks_of_utc,
)
from wil_campaign.plugins.signed_links.signing_key import SigningKey, signing_key
from wil_campaign.vehicles.links.link import (
    ConfirmsSenders,
    Link,
    TellsTrouble,
    WrappedLink,
)
from wil_campaign.vehicles.links.link_conditions import SIGNING, KeySource, LinkLayer, LinkSite
from wil_campaign.vehicles.mavlink.framing import FrameSplitter, MavlinkFrame


@dataclass(frozen=True)
class Signing(LinkLayer):
    """The signing of a vehicle's links. source: of their key. utc_s: as of SignedLink."""

    source: KeySource
    utc_s: float
    name: str = SIGNING

    def over(self, links: Sequence[Link], site: LinkSite) -> list[Link]:  # noqa: ARG002 - of the layer
        """Return signed links over these ones. Raises SigningKeyError."""
        key = signing_key(self.source)
        return [
            SignedLink(link=link, key=key, utc_s=self.utc_s, link_id=number)
            for number, link in enumerate(links)
        ]


class SignedLink(WrappedLink):
    """A link with MAVLink 2 signing; its users read and write unsigned frames.

    utc_s: the time (UTC, seconds since 1970) when the link is opened; it advances with the loop's
    clock. link_id: distinguishes several links with one key. newest: the last timestamp of an
    earlier link with this key, where the wall clock may have been set back.
    """

    def __init__(
        self, *, link: Link, key: SigningKey, utc_s: float, link_id: int = 0, newest: int = 0
    ) -> None:
        self._senders = link if isinstance(link, ConfirmsSenders) else None
        self._signer = Signer(key=key, link_id=link_id, newest=newest)
        self._start = ticks_of_utc(utc_s)
        self._start_s: float | None = None
        self._inward = FrameSplitter()
        self._outward = FrameSplitter()
        super().__init__(link)

    @property
    def counts(self) -> SigningCounts:
        """Return how many frames were signed, accepted, and refused for which reason."""
        return self._signer.counts

    @property
    def newest(self) -> int:
        """Return the last signing timestamp, for the next link with this key."""
        return self._signer.newest

    @property
    def trouble(self) -> str:
        """Return what the signed link refused, in words, and the wrapped link's error."""
        inner = self._link.trouble if isinstance(self._link, TellsTrouble) else ""
        counts = str(self.counts)
        refused = f"refused for its signature: {counts} frames" if counts else ""
        return "; ".join(text for text in (refused, inner) if text)

    def write(self, data: bytes) -> None:
        """Sign the frames and send them in one piece."""
        frames = self._outward.feed(data)
        now = self._now()
        signed = [self._signer.sign(frame, now) for frame in frames]
        if whole := b"".join([raw for raw in signed if raw is not None]):
            self._link.write(whole)

    async def __aenter__(self) -> Self:
        """Open the link under signing. Raises LinkError."""
        self._start_s = asyncio.get_running_loop().time()
        return await super().__aenter__()

    def _on_bytes(self, data: bytes, t_s: float) -> None:
        now = self._now()
        accepted = [self._checked_frame(frame, now) for frame in self._inward.feed(data)]
        if self._receiver is not None and (whole := b"".join(accepted)):
            self._receiver(whole, t_s)

    def _checked_frame(self, frame: MavlinkFrame, now: int) -> bytes:
        accepted = self._signer.check(frame, now)
        # The status of a radio is accepted without a signature, and proves nothing.
        if accepted is not None and frame.signed and self._senders is not None:
            self._senders.confirm_sender()
        return accepted or b""

    def _now(self) -> int:
        if self._start_s is None:
            return self._start
        elapsed_s = asyncio.get_running_loop().time() - self._start_s
        return self._start + round(elapsed_s * TICKS_PER_S)
