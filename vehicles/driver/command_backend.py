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
    """Sends one driver's commands to the vehicle (protocol)."""

    @property
    def speak(self) -> Speak | None:
        """Return the backend's sender of messages; None where the driver writes frames."""

    @property
    def sends_heartbeats(self) -> bool:
        """Return whether the backend sends a GCS's heartbeats by itself."""

    def join(self, link: Link) -> Link:
        """Return the link to receive by, which opens and closes `link` and the backend."""

    def on_failure(self, listener: FailureListener) -> None:
        """Call `listener` once when the command backend can send nothing any more."""

    async def await_vehicle(self, target: Target, timeout_s: float) -> None:
        """Set the backend's target vehicle. Raises VehicleError if it is not found."""

    def orders(
        self, *, commander: Commander, autopilot: Autopilot, target: Target
    ) -> VehicleCommands:
        """Return the backend's commands for the vehicle that was found."""

    def onboard(self, *, session: Session, circumstances: Callable[[], str]) -> Onboard:
        """Return the backend's access to onboard data: parameters, missions, logs."""


class FrameBackend:
    """The command backend of our own frames, written to the link; it never fails."""

    speak: Speak | None = None
    sends_heartbeats = False

    def join(self, link: Link) -> Link:
        """Return the link itself: this backend writes frames to it."""
        return link

    def on_failure(self, listener: FailureListener) -> None:
        """Ignore the listener: the frame backend never fails."""

    async def await_vehicle(self, target: Target, timeout_s: float) -> None:
        """Do nothing: the backend's frames carry their target."""

    def orders(
        self, *, commander: Commander, autopilot: Autopilot, target: Target
    ) -> VehicleCommands:
        """Return commands by COMMAND_LONG."""
        return VehicleCommands(commander=commander, autopilot=autopilot, target=target)

    def onboard(self, *, session: Session, circumstances: Callable[[], str]) -> Onboard:
        """Return onboard access by the session."""
        return Onboard(session=session, circumstances=circumstances)
