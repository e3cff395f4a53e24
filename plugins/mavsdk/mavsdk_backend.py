"""The command backend that sends a driver's commands through mavsdk.

Commands by mavsdk's `Action`, as far as it is sound; the others by MavlinkDirect.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.mavsdk.ids import OWN_COMPONENT, OWN_SYSTEM
from wil_campaign.plugins.mavsdk.mavsdk_client import MavsdkClient, MavsdkRefusedError
from wil_campaign.plugins.mavsdk.mavsdk_onboard import MavsdkLogs, MavsdkMissions
from wil_campaign.plugins.mavsdk.message_fields import message_fields_json
from wil_campaign.plugins.mavsdk.messages import Action, CallAction, ChooseSystem
from wil_campaign.plugins.mavsdk.relayed_link import RelayedLink
from wil_campaign.vehicles.autopilots.autopilot import Autopilot, FlightMode, MavlinkTarget
from wil_campaign.vehicles.driver.command_backend import FailureListener
from wil_campaign.vehicles.driver.onboard.onboard import Onboard
from wil_campaign.vehicles.driver.session.commands import Commander
from wil_campaign.vehicles.driver.session.session import MavlinkSession
from wil_campaign.vehicles.driver.vehicle_commands import Done, VehicleCommands
from wil_campaign.vehicles.errors import CommandError, CommandTimeoutError, IdentifyError
from wil_campaign.vehicles.links.link import Link
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

_TRIES = 2
_WITHIN_S = 6.0
"""mavsdk sends a command four times, half a second apart, and gives up."""
_MODES: dict[FlightMode, Action] = {
    FlightMode.HOLD: "hold",
    FlightMode.LAND: "land",
    FlightMode.RTL: "return_to_launch",
}


class MavsdkCommands(VehicleCommands):
    """The commands by mavsdk's `Action`: hold, land, return, disarm, terminate.

    Not arming (`Action.arm` can abort the process), takeoff (`Action.takeoff` climbs to a height
    that is a parameter of PX4, and blocks the next vehicle's), nor the guided mode (`Offboard`
    repeats the last setpoint forever).
    """

    def __init__(
        self,
        *,
        client: MavsdkClient,
        commander: Commander,
        autopilot: Autopilot,
        target: MavlinkTarget,
    ) -> None:
        super().__init__(commander=commander, autopilot=autopilot, target=target)
        self._client = client

    async def set_mode(self, mode: FlightMode, done: Done) -> None:
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
                await self._client.order(
                    partial(CallAction, action=action), f"Action.{action}", _WITHIN_S
                )
            except MavsdkRefusedError as error:
                if done():
                    return
                late = error.result == "TIMEOUT"
                if late and not last:
                    continue
                kind = CommandTimeoutError if late else CommandError
                raise kind(str(error), command=action, result=error.result) from error
            return


_FIND_S = 5.0
"""mavsdk knows a system once it has received its heartbeat; those come once a second."""


class MavsdkBackend:
    """The command backend of mavsdk, which runs in a separate process.

    name: of the vehicle, for messages. Wall clock only; one backend, process and instance of mavsdk
    for each vehicle. The driver's own ids must be mavsdk's: 245 and 190, which are the default.
    """

    sends_heartbeats = True

    def __init__(self, *, name: str) -> None:
        self._name = name
        self.client = MavsdkClient(name=name)
        self._codec = MavlinkCodec(system_id=OWN_SYSTEM, component_id=OWN_COMPONENT)
        self._link: Link | None = None

    @property
    def sender(self) -> Callable[[Any], None]:
        """Return the sender of messages by mavsdk's MavlinkDirect.

        A parameter whose bytes are no finite number (-1 of PX4's integers) is sent as a frame of
        ours: MavlinkDirect takes JSON, which keeps none of the bits of NaN.
        """
        return self._send_message

    def join(self, link: Link) -> Link:
        """Return the link with mavsdk on it."""
        self._link = RelayedLink(link=link, client=self.client)
        return self._link

    def on_failure(self, listener: FailureListener) -> None:
        """Call `listener` once when the mavsdk process has died or hangs."""
        self.client.on_failure(listener)

    async def await_vehicle(self, target: MavlinkTarget, timeout_s: float) -> None:
        """Select mavsdk's target system. Raises IdentifyError when it does not find it."""
        del timeout_s  # A heartbeat has already arrived: mavsdk needs at most a few more.
        make = partial(ChooseSystem, system_id=target.system, within_s=_FIND_S)
        try:
            await self.client.order(make, f"system {target.system}", 2.0 * _FIND_S)
        except MavsdkRefusedError as error:
            raise IdentifyError(
                f"{self._name}: system {target.system} sends heartbeats, but mavsdk does not find "
                f"it ({error.result})"
            ) from error

    def commands(
        self, *, commander: Commander, autopilot: Autopilot, target: MavlinkTarget
    ) -> VehicleCommands:
        """Return commands that use mavsdk's Action where that is sound."""
        return MavsdkCommands(
            client=self.client, commander=commander, autopilot=autopilot, target=target
        )

    def onboard(self, *, session: MavlinkSession, circumstances: Callable[[], str]) -> Onboard:
        """Return missions, fences and logs by mavsdk's plugins."""
        return Onboard(
            session=session,
            circumstances=circumstances,
            missions=MavsdkMissions(
                client=self.client, session=session, circumstances=circumstances
            ),
            logs=MavsdkLogs(client=self.client, session=session),
        )

    def _send_message(self, message: Any) -> None:
        if self._link is not None and _is_bits(message):
            self._link.write(self._codec.pack(message))
            return
        self.client.send_message(message.get_type(), message_fields_json(message))


def _is_bits(message: Any) -> bool:
    """Return whether a message is a PARAM_SET whose value holds an integer's bytes, no number."""
    is_parameter = message.get_msgId() == mavlink.MAVLINK_MSG_ID_PARAM_SET
    return is_parameter and not math.isfinite(message.param_value)
