"""UDP links: `udpin` listens and answers who speaks to it, `udpout` speaks first."""

import asyncio
import errno
import socket
from collections.abc import Callable
from dataclasses import dataclass
from typing import Self, cast

from vehicles.links.link import LinkError, Receiver
from vehicles.links.link_strings import LinkAddress

_SILENT_S = 1.5
"""A heartbeat and a half: who speaks MAVLink is not silent for so long."""
_FORGOTTEN_S = 60.0
"""A vehicle that a blackout hides keeps its place from whoever floods the port meanwhile."""
_MOST_SOURCES = 4
_SYSTEM_AT = {0xFD: 5, 0xFE: 3}
"""Where a frame of MAVLink 2 and 1 says which system sent it."""
_NO_MAVLINK = 0

_Address = tuple[str, int]


@dataclass(slots=True)
class _Source:
    """A UDP sender: its address, and when it was last received."""

    address: _Address
    heard_s: float


class UdpLink(asyncio.DatagramProtocol):
    """A UDP socket as a link; wall clock only.

    `udpin` binds to its address, hears everybody, and writes to all whom it heard, at most four. A
    MAVLink system is one vehicle: it is believed from the address that it was heard from first, as
    long as it speaks there; what comes from elsewhere in its name is let go, and told. What is
    written before anybody was heard is lost. `udpout` sends to its address and hears only that
    peer. signed: who is believed is settled by signatures instead.
    """

    def __init__(self, *, address: LinkAddress, signed: bool = False) -> None:
        self._address = address
        self._signed = signed
        self._receiver: Receiver | None = None
        self._transport: asyncio.DatagramTransport | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._sources: dict[int | _Address, _Source] = {}
        self._peers: tuple[_Address, ...] = ()
        """The addresses of all of them, the silent ones included."""
        self._trouble = ""
        self._rival: Callable[[str], None] | None = None
        self.rivals: dict[_Address, str] = {}
        """Who else spoke in the name of a system, in words; the first few."""

    @property
    def name(self) -> str:
        """Return the UDP link's link string."""
        return str(self._address)

    @property
    def trouble(self) -> str:
        """Return the operating system's last error of the UDP socket; empty when none."""
        return self._trouble

    @property
    def local_port(self) -> int:
        """Return the UDP link's own port; 0 when closed."""
        if self._transport is None:
            return 0
        return int(self._transport.get_extra_info("sockname")[1])

    def receive(self, receiver: Receiver) -> None:
        """Set the receiver of UDP bytes."""
        self._receiver = receiver

    def on_rival(self, listener: Callable[[str], None]) -> None:
        """Report to `listener` each UDP sender with another's system id."""
        self._rival = listener

    def write(self, data: bytes) -> None:
        """Send one UDP datagram to each known peer."""
        transport = self._transport
        if transport is None or transport.is_closing():
            return
        if self._address.kind == "udpout":
            transport.sendto(data)
        else:
            for address in self._peers:
                transport.sendto(data, address)

    async def __aenter__(self) -> Self:
        """Open the UDP socket. Raises LinkError when the port is taken or the host unknown."""
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

    async def __aexit__(self, *_: object) -> None:
        """Close the UDP socket."""
        self._receiver = None
        if self._transport is not None:
            self._transport.close()
            self._transport = None
            # The transport closes its socket one turn later; the port is free after this.
            await asyncio.sleep(0)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the UDP transport (asyncio calls this)."""
        # Python 3.11's own datagram transport is no subclass of DatagramTransport.
        self._transport = cast("asyncio.DatagramTransport", transport)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Pass a UDP datagram on with its time (asyncio calls this)."""
        if self._loop is None:
            return
        now_s = self._loop.time()
        key = addr if self._signed else _system_of(data)
        source = self._sources.get(key)
        if source is not None and source.address != addr and now_s - source.heard_s <= _SILENT_S:
            self._let_go(key, addr, source.address)
            return
        if source is not None and source.address == addr:
            source.heard_s = now_s
        elif source is not None or self._has_place(now_s):
            self._sources[key] = _Source(addr, now_s)
            self._peers = tuple(dict.fromkeys(one.address for one in self._sources.values()))
        if self._receiver is not None:
            self._receiver(data, now_s)

    def _has_place(self, now_s: float) -> bool:
        """Return whether one more UDP peer fits, in a silent one's place if need be."""
        if len(self._sources) < _MOST_SOURCES:
            return True
        key, oldest = min(self._sources.items(), key=lambda item: item[1].heard_s)
        if now_s - oldest.heard_s <= _FORGOTTEN_S:
            return False
        del self._sources[key]
        return True

    def _let_go(self, key: "int | _Address", rival: _Address, believed: _Address) -> None:
        if key == _NO_MAVLINK or rival in self.rivals or len(self.rivals) >= _MOST_SOURCES:
            return
        said = (
            f"system {key} speaks from {rival[0]}:{rival[1]} as well as from {believed[0]}:"
            f"{believed[1]}; two vehicles have the same system id; only the latter is accepted"
        )
        self.rivals[rival] = said
        if self._rival is not None:
            self._rival(said)

    def error_received(self, exc: Exception) -> None:
        """Keep a UDP error such as "connection refused" (asyncio calls this)."""
        self._trouble = (exc.strerror if isinstance(exc, OSError) else "") or str(exc)


def _system_of(data: bytes) -> int:
    """Return the system that sent a UDP datagram, by its first frame."""
    at = _SYSTEM_AT.get(data[0]) if data else None
    return data[at] if at is not None and len(data) > at else _NO_MAVLINK


def _remedy(error: OSError, address: LinkAddress) -> str:
    """Return what to do about a UDP error."""
    if isinstance(error, socket.gaierror):
        return f"host {address.host!r} is unknown; check its name, or give its IP address"
    if error.errno == errno.EADDRINUSE:
        return (
            f"port {address.port} is taken by another program (a ground station, or a run that "
            "was left over); end it, or choose another port"
        )
    if error.errno == errno.EADDRNOTAVAIL:
        return f"{address.host} is not an address of this machine; 0.0.0.0 listens on all of them"
    if error.errno in {errno.EACCES, errno.EPERM}:
        return f"no permission for port {address.port}; choose one above 1023"
    return f"{error.strerror or error}; check the network and the address"
