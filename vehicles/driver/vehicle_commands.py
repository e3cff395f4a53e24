"""The commands to a vehicle: modes, arming, takeoff, termination."""

import asyncio
from collections.abc import Callable

from wil_campaign.vehicles.autopilots.autopilot import Autopilot, FlightMode, MavlinkTarget
from wil_campaign.vehicles.driver.session.commands import Commander

Done = Callable[[], bool]
"""Returns whether a command has taken effect, though its acknowledgement was lost."""


class VehicleCommands:
    """A vehicle's commands, each a COMMAND_LONG; awaiting one returns once it is accepted.

    All raise CommandError when refused, CommandTimeoutError when not answered.
    """

    def __init__(
        self, *, commander: Commander, autopilot: Autopilot, target: MavlinkTarget
    ) -> None:
        self.commander = commander
        self.autopilot = autopilot
        self.target = target

    async def set_mode(self, mode: FlightMode, done: Done) -> None:
        """Command the mode HOLD, GUIDED, LAND or RTL."""
        message = self.autopilot.set_mode(self.target, mode)
        await self.commander.run(message, done_anyway=done)

    async def arm(self, done: Done) -> None:
        """Command arming, with all of the autopilot's checks."""
        await self.commander.run(self.autopilot.arm(self.target), done_anyway=done)

    async def disarm(self, done: Done) -> None:
        """Command disarming on the ground."""
        await self.commander.run(self.autopilot.disarm(self.target), done_anyway=done)

    def begin_takeoff(
        self, altitude_m: float, *, ground_amsl_m: float | None, done: Done
    ) -> asyncio.Future[None]:
        """Send the takeoff command now; the future is done once it is accepted.

        ground_amsl_m: see `Autopilot.takeoff`.
        """
        message = self.autopilot.takeoff(
            self.target, altitude_m=altitude_m, ground_amsl_m=ground_amsl_m
        )
        return self.commander.begin(message, done_anyway=done, urgent=True)

    async def terminate(self) -> None:
        """Command the motors to stop at once, in the air too."""
        await self.commander.run(self.autopilot.terminate(self.target))
