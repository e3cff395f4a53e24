"""UDP links: `udpin` listens and replies to its senders, `udpout` sends first."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Self, cast

from vehicles.links.link import LinkError, Receiver
from vehicles.links.link_strings import LinkAddress
from vehicles.links.reads import shorten_reads
from vehicles.links.socket_errors import socket_remedy

_SILENT_S = 1.5
"""A heartbeat and a half: a MAVLink system is not silent for so long."""
_FORGOTTEN_S = 60.0
"""A vehicle keeps its place for so long during a link outage, even if others flood the port."""
_MOST_SOURCES = 4
_SYSTEM_AT = {0xFD: 5, 0xFE: 3}
"""The offset of the system id in a frame of MAVLink 2 and 1."""
_NO_MAVLINK = 0

_Address = tuple[str, int]


@dataclass(slots=True)
class _Source:
    """A UDP sender: its address, and when it was last received."""

    address: _Address
    last_received_s: float


class UdpLink(asyncio.DatagramProtocol):
    """A UDP socket as a link; wall clock only.

    `udpin` binds to its address, receives from any sender, and writes to all senders, at most four.
    A MAVLink system is one vehicle: it is accepted from its first address as long as it sends from
    there; frames with its system id from another address are dropped and reported. Bytes written
    before anything was received are lost. `udpout` sends to its address and receives only from
    that peer. signed: senders are authenticated by signatures instead.
    """

    def __init__(self, *, address: LinkAddress, signed: bool = False) -> None:
        self._address = address
        self._signed = signed
        self._receiver: Receiver | None = None
        self._transport: asyncio.DatagramTransport | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._sources: dict[int | _Address, _Source] = {}
        self._peers: tuple[_Address, ...] = ()
        """The addresses of all sources, the silent ones included."""
        self._trouble = ""
        self._on_rival: Callable[[str], None] | None = None
        self.rivals: dict[_Address, str] = {}
        """Messages about other senders with the same system id, by address; the first few."""

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
        """Call `listener` with a message for each UDP sender with another's system id."""
        self._on_rival = listener

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
            raise LinkError(f"{self.name}: {socket_remedy(error, self._address)}") from error
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
        shorten_reads(transport)
        # Python 3.11's own datagram transport is no subclass of DatagramTransport.
        self._transport = cast("asyncio.DatagramTransport", transport)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Pass a UDP datagram on with its time (asyncio calls this)."""
        if self._loop is None:
            return
        now_s = self._loop.time()
        key = addr if self._signed else _system_of(data)
        source = self._sources.get(key)
        if (
            source is not None
            and source.address != addr
            and now_s - source.last_received_s <= _SILENT_S
        ):
            self._report_rival(key, addr, source.address)
            return
        if source is not None and source.address == addr:
            source.last_received_s = now_s
        elif source is not None or self._has_place(now_s):
            self._sources[key] = _Source(addr, now_s)
            self._peers = tuple(dict.fromkeys(one.address for one in self._sources.values()))
        if self._receiver is not None:
            self._receiver(data, now_s)

    def _has_place(self, now_s: float) -> bool:
        """Return whether one more UDP peer fits, in a silent one's place if need be."""
        if len(self._sources) < _MOST_SOURCES:
            return True
        key, oldest = min(self._sources.items(), key=lambda item: item[1].last_received_s)
        if now_s - oldest.last_received_s <= _FORGOTTEN_S:
            return False
        del self._sources[key]
        return True

    def _report_rival(self, key: "int | _Address", rival: _Address, accepted: _Address) -> None:
        if key == _NO_MAVLINK or rival in self.rivals or len(self.rivals) >= _MOST_SOURCES:
            return
        message = (
            f"system {key} sends from {rival[0]}:{rival[1]} as well as from {accepted[0]}:"
            f"{accepted[1]}: two vehicles have the same system id; only the latter is accepted"
        )
        self.rivals[rival] = message
        if self._on_rival is not None:
            self._on_rival(message)

    def error_received(self, exc: Exception) -> None:
        """Keep a UDP error such as "connection refused" (asyncio calls this)."""
        self._trouble = (exc.strerror if isinstance(exc, OSError) else "") or str(exc)


def _system_of(data: bytes) -> int:
    """Return the system that sent a UDP datagram, by its first frame."""
    at = _SYSTEM_AT.get(data[0]) if data else None
    return data[at] if at is not None and len(data) > at else _NO_MAVLINK
