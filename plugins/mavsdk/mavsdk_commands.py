"""Commands by mavsdk's `Action`, as far as it is sound; the others by MavlinkDirect."""

from functools import partial

from wil_campaign.plugins.mavsdk.mavsdk_client import MavsdkClient, RefusedError
from wil_campaign.plugins.mavsdk.messages import Act, Action
from wil_campaign.vehicles.autopilots.autopilot import Autopilot, Mode, Target
from wil_campaign.vehicles.driver.session.commands import Commander
from wil_campaign.vehicles.driver.vehicle_commands import Done, VehicleCommands
from wil_campaign.vehicles.errors import CommandError, CommandTimeoutError

_TRIES = 2
_WITHIN_S = 6.0
"""mavsdk sends a command four times, half a second apart, and gives up."""
_MODES: dict[Mode, Action] = {
    Mode.HOLD: "hold",
    Mode.LAND: "land",
    Mode.RTL: "return_to_launch",
}


class MavsdkCommands(VehicleCommands):
    """The commands by mavsdk's `Action`: hold, land, return, disarm, terminate.

    Not arming (`Action.arm` can abort the process), takeoff (`Action.takeoff` climbs to a height
    that is a parameter of PX4, and blocks the next vehicle's), nor the guided mode (`Offboard`
    repeats the last setpoint forever).
    """

    def __init__(
        self, *, client: MavsdkClient, commander: Commander, autopilot: Autopilot, target: Target
    ) -> None:
        super().__init__(commander=commander, autopilot=autopilot, target=target)
        self._client = client

    async def set_mode(self, mode: Mode, done: Done) -> None:
        """Command HOLD, GUIDED, LAND or RTL by mavsdk."""
        if mode in _MODES:
            await self._act(_MODES[mode], done)
        else:
            await super().set_mode(mode, done)

    async def disarm(self, done: Done) -> None:
        """Command disarming on the ground by mavsdk."""
        await self._act("disarm", done)

    async def terminate(self) -> None:
        """Command the motors to stop at once by mavsdk, in the air too."""
        await self._act("terminate", lambda: False)

    async def _act(self, action: Action, done: Done) -> None:
        """Call `Action`; repeat it once after a time-out without visible effect."""
        for last in (*[False] * (_TRIES - 1), True):
            try:
                await self._client.order(partial(Act, action=action), f"Action.{action}", _WITHIN_S)
            except RefusedError as error:
                if done():
                    return
                late = error.result == "TIMEOUT"
                if late and not last:
                    continue
                kind = CommandTimeoutError if late else CommandError
                raise kind(str(error), command=action, result=error.result) from error
            return
