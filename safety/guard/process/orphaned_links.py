"""Receives from vehicles on the links of a guard that died, and never sends.

The autopilots' own failsafes must act then, and they act on silence.
"""

import asyncio
from collections.abc import Callable, Mapping
from contextlib import AsyncExitStack
from typing import Self

from wil_campaign.safety.guard.process.guard_config import GuardedVehicleConfig
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget
from wil_campaign.vehicles.autopilots.registry import is_flyable_vehicle
from wil_campaign.vehicles.links.link import Link, LinkError
from wil_campaign.vehicles.links.link_factory import open_link
from wil_campaign.vehicles.links.link_strings import LinkAddress, parse_link
from wil_campaign.vehicles.links.udp import UdpLink
from wil_campaign.vehicles.mavlink.fields import read_heartbeat
from wil_campaign.vehicles.mavlink.framing import FrameSplitter
from wil_campaign.vehicles.mavlink.heartbeats import heartbeat_kind

Received = Callable[[str, bytes, float], None]
_RETRY_S = 0.2
_RETRIES = 10


class OrphanedLinks:
    """Listens on the links orphaned by a dead guard; an async context manager.

    received: called with what arrives, by vehicle. A link that cannot be opened is named in
    `unavailable`.
    """

    def __init__(
        self,
        *,
        links: Mapping[str, Callable[[], Link]],
        targets: Mapping[str, MavlinkTarget],
        received: Received,
    ) -> None:
        self._links = dict(links)
        self._targets = dict(targets)
        self._received = received
        self._splitters = {name: FrameSplitter() for name in links}
        self._stack = AsyncExitStack()
        self.armed: dict[str, bool] = {}
        """The last received state of each vehicle; a silent vehicle is not in it."""
        self.unavailable: dict[str, str] = {}

    async def __aenter__(self) -> Self:
        """Open all orphaned links that can be opened."""
        for name, make in self._links.items():
            await self._open(name, make)
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close the orphaned links."""
        await self._stack.aclose()

    async def _open(self, name: str, make: Callable[[], Link]) -> None:
        for _ in range(_RETRIES):
            link = make()
            link.receive(lambda data, t_s: self._take(name, data, t_s))
            try:
                await self._stack.enter_async_context(link)
            except LinkError as error:
                # The kernel may not have taken the dead process's socket back yet.
                self.unavailable[name] = str(error)
                await asyncio.sleep(_RETRY_S)
            else:
                self.unavailable.pop(name, None)
                return

    def _take(self, name: str, data: bytes, t_s: float) -> None:
        target = self._targets[name]
        for frame in self._splitters[name].feed(data):
            ours = frame.system == target.system and frame.component == target.component
            kind = heartbeat_kind(frame) if ours else None
            if kind is not None and is_flyable_vehicle(*kind):
                self.armed[name] = read_heartbeat(frame).armed
        self._received(name, data, t_s)


def orphaned_link_maker(guarded: GuardedVehicleConfig, port: int) -> Callable[[], Link]:
    """Return what reopens a vehicle's orphaned link. port: for a link that is no string."""
    if guarded.link:
        return lambda: open_link(parse_link(guarded.link))
    address = LinkAddress(kind="udpin", host="127.0.0.1", port=port)
    return lambda: UdpLink(address=address)
