"""UDP links: `udpin` listens and answers who speaks to it, `udpout` speaks first."""

import asyncio
import errno
import socket
from types import TracebackType
from typing import Self, cast

from vehicles.links.base import LinkError, Receiver
from vehicles.links.parse import LinkAddress

_SILENT_S = 1.5
"""A heartbeat and a half: who speaks MAVLink is not silent for so long."""


class UdpLink(asyncio.DatagramProtocol):
    """A UDP socket as a link; wall clock only.

    `udpin` binds to its address, hears everybody, and writes to the peer that it heard first, for
    as long as that one speaks: whoever else sends there must not draw our commands to himself.
    What is written before is lost. `udpout` sends to its address and hears only that peer.
    """

    def __init__(self, *, address: LinkAddress) -> None:
        self._address = address
        self._receiver: Receiver | None = None
        self._transport: asyncio.DatagramTransport | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._peer: tuple[str, int] | None = None
        self._peer_s = 0.0
        self._trouble = ""

    @property
    def name(self) -> str:
        """Return the link string."""
        return str(self._address)

    @property
    def trouble(self) -> str:
        """Return what the operating system last said of the socket; empty when nothing."""
        return self._trouble

    @property
    def local_port(self) -> int:
        """Return the port that this end uses; 0 when closed."""
        if self._transport is None:
            return 0
        return int(self._transport.get_extra_info("sockname")[1])

    def receive(self, receiver: Receiver) -> None:
        """Set who is handed what arrives."""
        self._receiver = receiver

    def write(self, data: bytes) -> None:
        """Send one datagram, if a peer is known."""
        transport = self._transport
        if transport is None or transport.is_closing():
            return
        if self._address.kind == "udpout":
            transport.sendto(data)
        elif self._peer is not None:
            transport.sendto(data, self._peer)

    async def __aenter__(self) -> Self:
        """Open the socket. Raises LinkError when the port is taken or the host unknown."""
        self._loop = asyncio.get_running_loop()
        where = (self._address.host, self._address.port)
        try:
            if self._address.kind == "udpin":
                await self._loop.create_datagram_endpoint(lambda: self, local_addr=where)
            else:
                await self._loop.create_datagram_endpoint(lambda: self, remote_addr=where)
        except OSError as error:
            raise LinkError(f"{self.name}: {_remedy(error, self._address)}") from error
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the socket."""
        self._receiver = None
        if self._transport is not None:
            self._transport.close()
            self._transport = None
            # The transport closes its socket one turn later; the port is free after this.
            await asyncio.sleep(0)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the transport (asyncio calls this)."""
        # Python 3.11's own datagram transport is no subclass of DatagramTransport.
        self._transport = cast("asyncio.DatagramTransport", transport)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Hand a datagram on with its time (asyncio calls this)."""
        if self._loop is None:
            return
        now_s = self._loop.time()
        if addr == self._peer or self._peer is None or now_s - self._peer_s > _SILENT_S:
            self._peer, self._peer_s = addr, now_s
        if self._receiver is not None:
            self._receiver(data, now_s)

    def error_received(self, exc: Exception) -> None:
        """Remember a complaint such as "connection refused" (asyncio calls this)."""
        self._trouble = (exc.strerror if isinstance(exc, OSError) else "") or str(exc)


def _remedy(error: OSError, address: LinkAddress) -> str:
    if isinstance(error, socket.gaierror):
        return f"host {address.host!r} is unknown; check its name, or give its IP address"
    if error.errno == errno.EADDRINUSE:
        return (
            f"port {address.port} is taken by another program (a ground station, or a run that "
            "was left over); end it, or choose another port"
        )
    if error.errno == errno.EADDRNOTAVAIL:
        return f"{address.host} is no address of this machine; 0.0.0.0 listens on all of them"
    if error.errno in {errno.EACCES, errno.EPERM}:
        return f"no permission for port {address.port}; choose one above 1023"
    return f"{error.strerror or error}; check the network and the address"
