"""UDP links: `udpin` listens and replies to its senders, `udpout` sends first."""

import asyncio
import socket
from asyncio.trsock import TransportSocket
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Self, cast

from wil_campaign.vehicles.links.link import LinkError, ReceivingLink
from wil_campaign.vehicles.links.link_factory import LinkRequest
from wil_campaign.vehicles.links.link_strings import LinkAddress
from wil_campaign.vehicles.links.reads import shorten_reads
from wil_campaign.vehicles.links.socket_errors import socket_remedy

_SILENT_S = 1.5
"""A heartbeat and a half: a MAVLink system is not silent for so long."""
_FORGOTTEN_S = 60.0
"""A vehicle keeps its place for so long during a link outage, even if others flood the port."""
_OVERLAP_S = 0.5
"""One vehicle on two ways: frames that were under way on the old one arrive for no longer."""
_APART_S = 5.0
"""Frames that are farther apart are no sender beside another: each may have been under way."""
_RETURN_S = 10.0
"""A vehicle takes its place back at once from a sender that followed it so lately, or for as long
as it had the place before."""
_MOST_SOURCES = 4
_MOST_BESIDE = 8
_SYSTEM_AT = {0xFD: 5, 0xFE: 3}
"""The offset of the system id in a frame of MAVLink 2 and 1."""
_NO_MAVLINK = 0
_MOST_WAITING_BYTES = 16_384
"""The kernel's send buffer, which Linux doubles: some 40 frames instead of 270. Writes beyond that
are dropped: a late setpoint is worse than none."""

_ARP_S = 5.0
"""When what waited for an address that is gone is dropped by the kernel, and a margin."""

RIVAL_REMEDY = (
    "switch one off, or give one another id (MAV_SYS_ID of PX4, MAV_SYSID of ArduPilot, before 4.7 "
    "SYSID_THISMAV)"
)
"""What to do about two vehicles with one system id."""

_Address = tuple[str, int]


@dataclass(slots=True)
class _Beside:
    """Another address that sends with a sender's system id: since when, and until when.

    is_rival: whether the two sent for longer than one vehicle on two ways does: it is another.
    """

    since_s: float
    last_s: float
    is_rival: bool = False


@dataclass(slots=True)
class _Source:
    """A UDP sender: its address, when it was last received, and when it was accepted.

    beside: other addresses that sent with its system id meanwhile. first: the sender of this system
    that was received first; it may come back. confirmed: a frame from there had a correct
    signature.
    """

    address: _Address
    last_received_s: float
    accepted_s: float
    beside: dict[_Address, _Beside] = field(default_factory=dict)
    first: "_Source | None" = None
    confirmed: bool = False

    def is_remembered(self, now_s: float) -> bool:
        """Return whether a silent UDP sender may still come back."""
        return now_s - self.last_received_s <= _FORGOTTEN_S

    def silence_s(self, address: _Address) -> float:
        """Return how long this UDP sender must be silent until another address may follow it.

        Another vehicle, which sent beside it, must wait until this one is forgotten.
        """
        return _FORGOTTEN_S if self._is_rival(address) else _SILENT_S

    def note_beside(self, address: _Address, now_s: float) -> bool:
        """Note a frame from another address with the same system id; return if it is a rival's."""
        one = self.beside.get(address)
        if one is None or now_s - one.last_s > (_FORGOTTEN_S if one.is_rival else _APART_S):
            if one is None and self._is_crowded(now_s):
                return True
            one = self.beside[address] = _Beside(now_s, now_s)
        one.last_s = now_s
        one.is_rival = one.is_rival or self.last_received_s - one.since_s > _OVERLAP_S
        return one.is_rival

    def may_give_back(self, first: "_Source", now_s: float) -> bool:
        """Return whether the sender that was received first takes its place back at once."""
        had_it_s = first.last_received_s - first.accepted_s
        return first.is_remembered(now_s) and now_s - self.accepted_s <= max(_RETURN_S, had_it_s)

    def _is_crowded(self, now_s: float) -> bool:
        """Return whether no further address can be noted; those of long ago are forgotten."""
        if len(self.beside) >= _MOST_BESIDE:
            for address in [a for a, b in self.beside.items() if now_s - b.last_s > _FORGOTTEN_S]:
                del self.beside[address]
        return len(self.beside) >= _MOST_BESIDE

    def _is_rival(self, address: _Address) -> bool:
        one = self.beside.get(address)
        return len(self.beside) >= _MOST_BESIDE if one is None else one.is_rival


class UdpLink(ReceivingLink, asyncio.DatagramProtocol):
    """A UDP socket as a link; wall clock only.

    `udpin` binds to its address, receives from any sender, and writes to all senders, at most four.
    A MAVLink system is one vehicle: it is accepted from its first address as long as it sends from
    there; frames with its system id from another address are dropped and reported. After a silence
    it is accepted from a new address, but for a minute not from one that kept sending beside it:
    that is another vehicle. For some seconds, or as long as it had its place, it takes that back at
    once. Bytes written before anything was received are lost. `udpout` sends to its address and
    receives only from that peer.
    What the network does not take is not kept: while some 40 frames wait, writes are dropped. With
    a second address there is room for as many as the kernel has by default: what waits for an
    address that is gone takes room from the others.
    signed: senders are authenticated by signatures instead; a new sender replaces the one that was
    silent longest, but no sender without a correct signature (`confirm_sender`) replaces one with
    it.
    """

    def __init__(self, *, address: LinkAddress, signed: bool = False) -> None:
        self._address = address
        self._signed = signed
        self._transport: asyncio.DatagramTransport | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._sources: dict[int | _Address, _Source] = {}
        self._default_waiting_bytes = _MOST_WAITING_BYTES
        self.dropped_writes = 0
        self._peers: tuple[_Address, ...] = ()
        """The addresses of all sources, the silent ones included."""
        self._sender: _Address | None = None
        """Where the datagram that is being received is from."""
        self._trouble = ""
        self._on_rival: Callable[[str], None] | None = None
        self._on_change: Callable[[str], None] | None = None
        self.rivals: dict[_Address, str] = {}
        """Messages about other senders with the same system id, by address; the first few."""
        self._lasting: set[_Address] = set()
        """Those of them that are rivals, and not one vehicle on two ways."""

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

    def on_rival(self, listener: Callable[[str], None]) -> None:
        """Call `listener` with a message for each UDP sender that sends beside another's system id.

        At once for those that were received already.
        """
        self._on_rival = listener
        for address in self._lasting & self.rivals.keys():
            listener(self.rivals[address])

    def on_change(self, listener: Callable[[str], None]) -> None:
        """Call `listener` with a message when a system sends from another UDP address."""
        self._on_change = listener

    def write(self, data: bytes) -> None:
        """Send one UDP datagram to each known peer, unless earlier ones are still waiting."""
        transport = self._transport
        if transport is None or transport.is_closing():
            return
        if cast("asyncio.WriteTransport", transport).get_write_buffer_size():
            self.dropped_writes += 1
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
        own = cast("TransportSocket", transport.get_extra_info("socket"))
        self._default_waiting_bytes = own.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF) // 2
        self._limit_waiting(_MOST_WAITING_BYTES)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Pass a UDP datagram on with its time (asyncio calls this)."""
        if self._loop is None:
            return
        now_s = self._loop.time()
        key = addr if self._signed else _system_of(data)
        if self._is_accepted(key, addr, now_s) and self._receiver is not None:
            self._sender = addr
            self._receiver(data, now_s)
            self._sender = None

    def confirm_sender(self) -> None:
        """Reply to the sender of the datagram being received: it has a correct signature."""
        if self._sender is None or self._loop is None or not self._signed:
            return
        source = self._sources.get(self._sender)
        if source is None:
            if len(self._sources) >= _MOST_SOURCES:
                del self._sources[self._replaceable()]
            source = _Source(self._sender, self._loop.time(), self._loop.time())
            self._set_source(self._sender, source)
        source.confirmed = True

    def _is_accepted(self, key: "int | _Address", address: _Address, now_s: float) -> bool:
        source = self._sources.get(key)
        if source is None:
            if self._has_place(now_s):
                self._set_source(key, _Source(address, now_s, now_s))
            return True
        if source.address == address:
            source.last_received_s = now_s
            return True
        first = source.first
        if first is not None and not first.is_remembered(now_s):
            first = None
        returns = (
            first is not None and first.address == address and source.may_give_back(first, now_s)
        )
        if not returns:
            is_rival = source.note_beside(address, now_s)
            if now_s - source.last_received_s <= source.silence_s(address):
                self._report_rival(key, address, source.address, is_rival=is_rival)
                return False
        self._report_change(key, source, address, now_s, returns=returns)
        source.beside.pop(address, None)
        self.rivals.pop(address, None)
        if returns:
            first = None
        elif first is None or first.address == address:
            first = _Source(source.address, source.last_received_s, source.accepted_s)
        self._set_source(key, _Source(address, now_s, now_s, source.beside, first))
        return True

    def _set_source(self, key: "int | _Address", source: _Source) -> None:
        """Accept a UDP sender, and reply to it from now on."""
        if self._peers and source.address not in self._peers and self._loop is not None:
            # Without an answer to ARP the kernel keeps frames for 3 s: 40 of them, and all wait.
            self._limit_waiting(self._default_waiting_bytes)
            self._loop.call_later(_ARP_S, self._limit_waiting_of_one)
        self._sources[key] = source
        self._peers = tuple(dict.fromkeys(one.address for one in self._sources.values()))

    def _limit_waiting_of_one(self) -> None:
        """Let little wait again where the other address was that of a vehicle which moved."""
        if len(self._peers) == 1:
            self._limit_waiting(_MOST_WAITING_BYTES)

    def _limit_waiting(self, most_bytes: int) -> None:
        """Limit what waits in the kernel's send buffer of the UDP socket."""
        if self._transport is not None and not self._transport.is_closing():
            own = cast("TransportSocket", self._transport.get_extra_info("socket"))
            own.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, most_bytes)

    def _has_place(self, now_s: float) -> bool:
        """Return whether one more UDP peer fits, in a silent one's place if need be."""
        if len(self._sources) < _MOST_SOURCES:
            return True
        key = self._replaceable()
        oldest = self._sources[key]
        if oldest.confirmed or (not self._signed and oldest.is_remembered(now_s)):
            return False
        del self._sources[key]
        return True

    def _replaceable(self) -> "int | _Address":
        """Return the UDP peer to replace first: without a signature, then silent longest."""
        return min(
            self._sources,
            key=lambda key: (self._sources[key].confirmed, self._sources[key].last_received_s),
        )

    def _report_rival(
        self, key: "int | _Address", rival: _Address, accepted: _Address, *, is_rival: bool
    ) -> None:
        """Keep a message about another sender; report it once it is certain to be a rival."""
        if key == _NO_MAVLINK:
            return
        if rival not in self.rivals and len(self.rivals) < _MOST_SOURCES:
            self.rivals[rival] = (
                f"system {key} sends from {_text(rival)} as well as from {_text(accepted)}: "
                "two vehicles have the same system id; only the latter is accepted"
            )
        if is_rival and rival in self.rivals and rival not in self._lasting:
            self._lasting.add(rival)
            if self._on_rival is not None:
                self._on_rival(self.rivals[rival])

    def _report_change(
        self, key: "int | _Address", last: _Source, new: _Address, now_s: float, *, returns: bool
    ) -> None:
        """Report a system's change of address. returns: back to its first one."""
        if key == _NO_MAVLINK or self._on_change is None:
            return
        again = " again, where it was received first" if returns else ""
        self._on_change(
            f"system {key} now sends from {_text(new)}{again}; it was last received from "
            f"{_text(last.address)} {now_s - last.last_received_s:.1f} s ago"
        )

    def error_received(self, exc: Exception) -> None:
        """Keep a UDP error such as "connection refused" (asyncio calls this)."""
        self._trouble = (exc.strerror if isinstance(exc, OSError) else "") or str(exc)


def _text(address: _Address) -> str:
    return f"{address[0]}:{address[1]}"


def _system_of(data: bytes) -> int:
    """Return the system that sent a UDP datagram, by its first frame."""
    at = _SYSTEM_AT.get(data[0]) if data else None
    return data[at] if at is not None and len(data) > at else _NO_MAVLINK


def udp_link(request: LinkRequest) -> UdpLink:
    """Return the UDP link that is asked for."""
    return UdpLink(address=request.address, signed=request.signed)
