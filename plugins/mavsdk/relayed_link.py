"""A link that is shared with mavsdk: mavsdk receives its bytes, and sends on it.

The bytes are relayed over a loopback socket, as from vehicle to ground station: mavsdk reads and
writes it in its own threads, without Python.
"""

import asyncio
from typing import Self, cast

from wil_campaign.plugins.mavsdk.mavsdk_client import MavsdkClient
from wil_campaign.vehicles.links.link import Link, LinkError, Receiver
from wil_campaign.vehicles.links.reads import shorten_reads

_HOST = "127.0.0.1"


class RelayedLink(asyncio.DatagramProtocol):
    """A link relayed to its receiver and to mavsdk; wall clock only.

    Opening it opens the link and starts mavsdk; closing ends both. It relays only the first
    sender's packets, which is mavsdk.
    """

    def __init__(self, *, link: Link, client: MavsdkClient) -> None:
        self._link = link
        self._client = client
        self._receiver: Receiver | None = None
        self._transport: asyncio.DatagramTransport | None = None
        self._peer: tuple[str, int] | None = None
        link.receive(self._on_datagram)

    @property
    def name(self) -> str:
        """Return the name of the relayed link."""
        return self._link.name

    @property
    def trouble(self) -> str:
        """Return the relayed link's last error; empty without one."""
        return str(getattr(self._link, "trouble", ""))

    def receive(self, receiver: Receiver) -> None:
        """Set the receiver of the relayed link's bytes."""
        self._receiver = receiver

    def write(self, data: bytes) -> None:
        """Send bytes on the relayed link beside mavsdk's."""
        self._link.write(data)

    async def __aenter__(self) -> Self:
        """Open the link, and mavsdk's relay on it. Raises LinkError."""
        await self._link.__aenter__()
        try:
            await self._open()
        except BaseException:
            await self._close()
            await self._link.__aexit__(None, None, None)
            raise
        return self

    async def __aexit__(self, *raised: object) -> None:
        """End mavsdk and close the relayed link."""
        try:
            await self._close()
        finally:
            await self._link.__aexit__(*raised)

    async def _open(self) -> None:
        loop = asyncio.get_running_loop()
        try:
            await loop.create_datagram_endpoint(lambda: self, local_addr=(_HOST, 0))
        except OSError as error:
            raise LinkError(f"{self.name}: no port for mavsdk on {_HOST}: {error}") from error
        if self._transport is None:
            raise LinkError(f"{self.name}: the port for mavsdk closed at once")
        port = self._transport.get_extra_info("sockname")[1]
        await self._client.start(f"udpout://{_HOST}:{port}")

    async def _close(self) -> None:
        await self._client.end()
        if self._transport is not None:
            self._transport.close()
            self._transport = None
            # The transport closes its socket one turn later.
            await asyncio.sleep(0)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the relay's transport (asyncio calls this)."""
        shorten_reads(transport)
        # Python 3.11's own datagram transport is no subclass of DatagramTransport.
        self._transport = cast("asyncio.DatagramTransport", transport)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Relay what mavsdk sends (asyncio calls this)."""
        if self._peer is None:
            self._peer = addr
        if addr == self._peer:
            self._link.write(data)

    def error_received(self, exc: Exception) -> None:
        """Ignore the error: the exit of mavsdk's process is reported elsewhere."""

    def _on_datagram(self, data: bytes, t_s: float) -> None:
        if self._receiver is not None:
            self._receiver(data, t_s)
        if self._peer is not None and self._transport is not None:
            self._transport.sendto(data, self._peer)
