"""The wire between a run and its node (protocol), and what a message on it brings."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from wil_campaign.plugins.ros2.messages.topics import OutTopic
from wil_campaign.vehicles.errors import VehicleError


class WireError(VehicleError):
    """The wire to the node cannot be opened; says why, and the remedy."""


@dataclass(frozen=True, slots=True)
class InMessage:
    """A message of a node. type: as the node has it. sender: of the publisher; "" where unknown.

    cdr: None where only the publisher is known, and nothing came yet.
    """

    topic: str
    type: str
    cdr: bytes | None
    sender: str = ""


Take = Callable[[InMessage], None]
"""Takes a message; called in threads of the wire."""


class NodeWire(Protocol):
    """Publishes to a node and hears from it. Its methods may be called in any thread."""

    def advertise(self, topic: OutTopic, name: str) -> None:
        """Offer a topic under a name, before anything is published on it."""

    def listen(self, name: str, type_: str, take: Take) -> None:
        """Call `take` with each message on a topic, also with those of another type."""

    def is_subscribed(self, name: str) -> bool:
        """Return whether anybody subscribes to an advertised topic."""
        ...

    def publish(self, name: str, cdr: bytes, stamp_ns: int) -> bool:
        """Publish a message; return whether the wire took it."""
        ...

    def mismatches(self) -> list[str]:
        """Return in words the subscriptions to our topics that get nothing, and why."""
        ...

    def trouble(self) -> str:
        """Return in words why nothing goes over the wire any more; "" while it does."""
        ...

    def environment(self) -> Mapping[str, str]:
        """Return the variables by which a node that is started finds the wire."""
        ...

    def close(self) -> None:
        """Close the wire."""
