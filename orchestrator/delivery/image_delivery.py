"""What every delivery of pictures is: one protocol, its counts, its errors."""

from dataclasses import dataclass
from typing import Protocol, Self, runtime_checkable

from vehicles.errors import VehicleError
from vehicles.readings import CameraReading


class DeliveryError(VehicleError):
    """An image delivery that cannot be opened or used; says which, and what to do."""


@dataclass(frozen=True, slots=True)
class DeliveryCounts:
    """The counts of an image delivery: offered, delivered, dropped, failed.

    offered: handed to `deliver`. delivered: sent. dropped: made way for a newer one, because the
    way out was busy. failed: could not be sent; `trouble` says why the last one could not.
    """

    offered: int = 0
    delivered: int = 0
    dropped: int = 0
    failed: int = 0


@runtime_checkable
class Delivery(Protocol):
    """An image delivery (protocol); an async context manager.

    `deliver` returns at once, whatever happens outside: it never holds up a flight and never
    raises. What cannot be sent in time is dropped and counted.
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

    def deliver(self, reading: CameraReading) -> None:
        """Deliver an image reading soon, without blocking."""

    async def __aenter__(self) -> Self:
        """Open the image delivery. Raises DeliveryError."""

    async def __aexit__(self, *_: object) -> None:
        """Deliver images that still wait, and close."""
