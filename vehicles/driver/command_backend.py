"""How a driver sends commands to its vehicle: as our own MAVLink frames, or otherwise.

Telemetry is always received by the driver itself, so that estimates, states and events, which
verdicts are based on, are the same with every backend.
"""

from collections.abc import Callable
from typing import Any, Protocol

from wil_campaign.vehicles.autopilots.autopilot import Autopilot, MavlinkTarget
from wil_campaign.vehicles.driver.onboard.onboard import Onboard
from wil_campaign.vehicles.driver.session.commands import Commander
from wil_campaign.vehicles.driver.session.session import MavlinkSession
from wil_campaign.vehicles.driver.vehicle_commands import VehicleCommands
from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.vehicles.links.link import Link

MessageSender = Callable[[Any], None]
FailureListener = Callable[[VehicleError], None]


class CommandBackend(Protocol):
    """Sends one driver's commands to the vehicle (protocol)."""

    @property
    def sender(self) -> MessageSender | None:
        """Return the backend's sender of messages; None when the driver writes frames."""

    @property
    def sends_heartbeats(self) -> bool:
        """Return whether the backend sends a GCS's heartbeats by itself."""

    def join(self, link: Link) -> Link:
        """Return the link to receive by, which opens and closes `link` and the backend."""

    def on_failure(self, listener: FailureListener) -> None:
        """Call `listener` once when the command backend can no longer send."""

    async def await_vehicle(self, target: MavlinkTarget, timeout_s: float) -> None:
        """Set the backend's target vehicle. Raises VehicleError if it is not found."""

    def commands(
        self, *, commander: Commander, autopilot: Autopilot, target: MavlinkTarget
    ) -> VehicleCommands:
        """Return the backend's commands for the identified vehicle."""

    def onboard(self, *, session: MavlinkSession, circumstances: Callable[[], str]) -> Onboard:
        """Return the backend's access to onboard data: parameters, missions, logs."""


class FrameBackend:
    """The command backend of our own frames, written to the link; it never fails."""

    sender: MessageSender | None = None
    sends_heartbeats = False

    def join(self, link: Link) -> Link:
        """Return the link itself: this backend writes frames to it."""
        return link

    def on_failure(self, listener: FailureListener) -> None:
        """Ignore the listener: the frame backend never fails."""

    async def await_vehicle(self, target: MavlinkTarget, timeout_s: float) -> None:
        """Do nothing: the backend's frames carry their target."""

    def commands(
        self, *, commander: Commander, autopilot: Autopilot, target: MavlinkTarget
    ) -> VehicleCommands:
        """Return commands by COMMAND_LONG."""
        return VehicleCommands(commander=commander, autopilot=autopilot, target=target)

    def onboard(self, *, session: MavlinkSession, circumstances: Callable[[], str]) -> Onboard:
        """Return onboard access through the session."""
        return Onboard(session=session, circumstances=circumstances)
