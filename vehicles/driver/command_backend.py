"""How a driver speaks to its vehicle: in frames of its own, or by the library of another client.

What a driver hears it always reads itself, so that estimates, states and events, which verdicts
rest on, are the same whoever speaks.
"""

from collections.abc import Callable
from typing import Any, Protocol

from vehicles.autopilots.autopilot import Autopilot, Target
from vehicles.driver.onboard.onboard import Onboard
from vehicles.driver.session.commands import Commander
from vehicles.driver.session.session import Session
from vehicles.driver.vehicle_commands import VehicleCommands
from vehicles.errors import VehicleError
from vehicles.links.link import Link

Speak = Callable[[Any], None]
FailureListener = Callable[[VehicleError], None]


class CommandBackend(Protocol):
    """Who speaks for a driver; of one driver only."""

    @property
    def speak(self) -> Speak | None:
        """Return what says a message; None where the driver writes frames itself."""

    @property
    def sends_heartbeats(self) -> bool:
        """Return whether it sends a ground station's heartbeats by itself."""

    def join(self, link: Link) -> Link:
        """Return the link to hear by, which opens and closes `link` and the voice with it."""

    def on_failure(self, listener: FailureListener) -> None:
        """Call `listener` once when nothing can be said any more."""

    async def await_vehicle(self, target: Target, timeout_s: float) -> None:
        """Take note of whom to speak to. Raises VehicleError when it does not find it."""

    def orders(
        self, *, commander: Commander, autopilot: Autopilot, target: Target
    ) -> VehicleCommands:
        """Return who gives orders to the vehicle that was found."""

    def onboard(self, *, session: Session, circumstances: Callable[[], str]) -> Onboard:
        """Return the access to what is kept on board."""


class FrameBackend:
    """Frames of our own, written to the link; it never fails."""

    speak: Speak | None = None
    sends_heartbeats = False

    def join(self, link: Link) -> Link:
        """Return the link itself."""
        return link

    def on_failure(self, listener: FailureListener) -> None:
        """Never call it."""

    async def await_vehicle(self, target: Target, timeout_s: float) -> None:
        """Go on: frames carry their target."""

    def orders(
        self, *, commander: Commander, autopilot: Autopilot, target: Target
    ) -> VehicleCommands:
        """Return orders by COMMAND_LONG."""
        return VehicleCommands(commander=commander, autopilot=autopilot, target=target)

    def onboard(self, *, session: Session, circumstances: Callable[[], str]) -> Onboard:
        """Return access by the session."""
        return Onboard(session=session, circumstances=circumstances)
