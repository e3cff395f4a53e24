"""Redundant links to one vehicle: one is active, the others take over when it falls silent."""

import asyncio
from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass
from functools import partial
from typing import Self

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.links.link import Link, ReceivingLink, TellsTrouble
from wil_campaign.vehicles.links.link_conditions import LinkLayer, LinkSite
from wil_campaign.vehicles.mavlink.framing import FrameSplitter, MavlinkFrame
from wil_campaign.vehicles.mavlink.heartbeats import heartbeat_kind

SILENT_S = 0.3
"""After this silence another link becomes active: long before the driver counts the vehicle's link
as lost (1.5 s), and three periods of the slowest telemetry. A needless switch costs little."""
STEADY_S = 5.0
"""How long a link listed earlier must receive without a gap before it becomes active again."""

_AUTOPILOT = mavlink.MAV_COMP_ID_AUTOPILOT1
_SENT_ON_ALL_LINKS = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_SET_MODE,
        mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
        mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
        mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
    }
)
_COMMANDS = frozenset({mavlink.MAVLINK_MSG_ID_COMMAND_LONG, mavlink.MAVLINK_MSG_ID_COMMAND_INT})
_COMMAND_AT = 28
"""The offset of the command's number in both, behind seven values of four bytes."""
_MESSAGE_ID_BYTES = 4
"""SET_MESSAGE_INTERVAL: param1 is the message whose rate is requested."""
_COMMANDS_ON_ALL_LINKS = frozenset(
    {
        mavlink.MAV_CMD_DO_SET_MODE,
        mavlink.MAV_CMD_NAV_LAND,
        mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,
        mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
        mavlink.MAV_CMD_DO_FLIGHTTERMINATION,
        mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
    }
)


@dataclass(frozen=True)
class Redundancy(LinkLayer):
    """Joins all links to a vehicle into a redundant one."""

    name: str = "spare_links"

    def over(self, links: Sequence[Link], site: LinkSite) -> list[Link]:
        """Return the one redundant link."""
        return [RedundantLink(links=links, system_id=site.system_id, on_switch=site.on_switch)]


class RedundantLink(ReceivingLink):
    """Redundant links as one: passes on what arrives on the active one.

    Autopilots number and time the messages of each link separately, so that two streams cannot be
    mixed. Idempotent messages (heartbeats, setpoints, modes, landing, disarming, telemetry rates)
    are written to all links, so that an abort does not depend on which link works; transactions
    (parameters, missions, takeoff) use the active one.

    Requested telemetry rates are requested again on a link that becomes active: it may have
    connected after the first request.

    links: the preferred one first; all must open at the start. system_id: the vehicle's, whose
    autopilot is the sign that a link works; None where it is not known. on_switch: called with a
    message when another link becomes active.
    """

    def __init__(
        self,
        *,
        links: Sequence[Link],
        system_id: int | None,
        on_switch: Callable[[str], None] | None = None,
    ) -> None:
        if len(links) < 2:
            raise ValueError("a redundant link needs two links at least")
        self._links = tuple(links)
        self._system_id = system_id
        self._on_switch = on_switch
        self._last_received_s = [0.0] * len(links)
        self._steady_since_s = [0.0] * len(links)
        self._inward = [FrameSplitter() for _ in links]
        self._outward = FrameSplitter()
        self._rate_requests: dict[bytes, bytes] = {}
        self._stack = AsyncExitStack()
        self.active = 0
        """The index of the active link."""
        for number, link in enumerate(self._links):
            link.receive(partial(self._on_bytes, number))

    @property
    def name(self) -> str:
        """Return the names of the redundant links, the preferred one first."""
        return " + ".join(link.name for link in self._links)

    @property
    def trouble(self) -> str:
        """Return the redundant links' errors; empty when none has any."""
        troubles = [
            f"{link.name}: {link.trouble}"
            for link in self._links
            if isinstance(link, TellsTrouble) and link.trouble
        ]
        return "; ".join(troubles)

    def write(self, data: bytes) -> None:
        """Send frames: on all redundant links if repeatable, else on the active one."""
        frames = self._outward.feed(data)
        for frame in frames:
            if _command_of(frame) == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
                self._rate_requests[frame.payload[:_MESSAGE_ID_BYTES]] = frame.raw
        for number, link in enumerate(self._links):
            active = number == self.active
            if mine := b"".join([one.raw for one in frames if active or _is_idempotent(one)]):
                link.write(mine)

    async def __aenter__(self) -> Self:
        """Open all redundant links. Raises LinkError for any; the others are closed."""
        now_s = asyncio.get_running_loop().time()
        self._last_received_s = [now_s] + [-SILENT_S] * (len(self._links) - 1)
        self._steady_since_s = [now_s] * len(self._links)
        async with AsyncExitStack() as stack:
            for link in self._links:
                await stack.enter_async_context(link)
            self._stack = stack.pop_all()
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close all redundant links."""
        await self._stack.aclose()

    def _on_bytes(self, number: int, data: bytes, t_s: float) -> None:
        if any(self._is_vehicle(frame) for frame in self._inward[number].feed(data)):
            self._take_sign_of_life(number, t_s)
        # Other bytes are passed on as well: the driver reports what it received instead of MAVLink.
        if number == self.active and self._receiver is not None:
            self._receiver(data, t_s)

    def _is_vehicle(self, frame: MavlinkFrame) -> bool:
        """Return whether a frame is of the vehicle's autopilot, not of another on its network."""
        if frame.component != _AUTOPILOT or self._system_id not in {None, frame.system}:
            return False
        kind = heartbeat_kind(frame)
        return kind is None or kind.autopilot != mavlink.MAV_AUTOPILOT_INVALID

    def _take_sign_of_life(self, number: int, t_s: float) -> None:
        if t_s - self._last_received_s[number] > SILENT_S:
            self._steady_since_s[number] = t_s
        self._last_received_s[number] = t_s
        active = self.active
        if number == active:
            return
        silent_s = t_s - self._last_received_s[active]
        if silent_s > SILENT_S:
            self._switch_to(number, f"{self._links[active].name} is silent for {silent_s:.1f} s")
        elif number < active and t_s - self._steady_since_s[number] >= STEADY_S:
            self._switch_to(number, f"{self._links[number].name} receives again without a gap")

    def _switch_to(self, number: int, why: str) -> None:
        self.active = number
        for raw in self._rate_requests.values():
            self._links[number].write(raw)
        if self._on_switch is not None:
            self._on_switch(f"{why}; switched to {self._links[number].name}")


def _is_idempotent(frame: MavlinkFrame) -> bool:
    """Return whether a frame may be sent on several redundant links."""
    return frame.message_id in _SENT_ON_ALL_LINKS or _command_of(frame) in _COMMANDS_ON_ALL_LINKS


def _command_of(frame: MavlinkFrame) -> int | None:
    """Return the MAV_CMD of a frame for redundant sending; None of another message."""
    if frame.message_id not in _COMMANDS:
        return None
    payload = frame.payload[: _COMMAND_AT + 2].ljust(_COMMAND_AT + 2, b"\0")
    return int.from_bytes(payload[_COMMAND_AT:], "little")
