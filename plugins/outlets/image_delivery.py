"""The protocol of all image deliveries, with its counts and its error."""

from dataclasses import dataclass
from typing import Any, Protocol, Self, runtime_checkable

from wil_campaign.vehicles.errors import VehicleError


class DeliveryError(VehicleError):
    """An image delivery that cannot be opened or used; the message says which, and the remedy."""


@dataclass(frozen=True, slots=True)
class DeliveryCounts:
    """The counts of an image delivery: offered, delivered, dropped, failed.

    offered: passed to `deliver`. delivered: sent. dropped: replaced by a newer one while the sink
    was busy, or still waiting when the delivery was closed. failed: not sent because of an error,
    or not in time at the end; `trouble` is the last one.
    """

    offered: int = 0
    delivered: int = 0
    dropped: int = 0
    failed: int = 0


@runtime_checkable
class ImageDelivery(Protocol):
    """An image delivery (protocol); an async context manager.

    `deliver` returns at once and never raises, whatever the receiver does: it never delays a
    flight. Images that cannot be sent in time are dropped and counted.
    """

    @property
    def name(self) -> str:
        """Return the image delivery's name in messages ("rtp://127.0.0.1:5600")."""

    @property
    def counts(self) -> DeliveryCounts:
        """Return the image delivery's counts so far."""

    @property
    def trouble(self) -> str:
        """Return why the last image failed to be delivered; empty when none has."""

    def deliver(self, reading: Any, /) -> None:
        """Deliver a reading, of a type that its sink takes, soon and without blocking."""

    async def __aenter__(self) -> Self:
        """Open the image delivery. Raises DeliveryError."""

    async def __aexit__(self, *_: object) -> None:
        """Deliver images that still wait, and close."""
