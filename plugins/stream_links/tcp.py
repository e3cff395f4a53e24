"""TCP links: `tcpout` connects, and reconnects when lost; `tcpin` listens for clients."""

import asyncio
import errno
import socket
import sys
from typing import Self

from wil_campaign.plugins.stream_links.byte_stream import StreamPeer
from wil_campaign.plugins.stream_links.reconnection import BackOff, Reconnection
from wil_campaign.vehicles.links.link import LinkError, ReceivingLink
from wil_campaign.vehicles.links.link_factory import LinkRequest
from wil_campaign.vehicles.links.link_strings import LinkAddress
from wil_campaign.vehicles.links.socket_errors import socket_remedy
from wil_campaign.vehicles.mavlink.framing import FrameSplitter

_SOON = BackOff(first_s=0.1, longest_s=0.5)
"""For a simulator that is being started: ArduPilot's SITL boots only once a client connects."""
_CONNECT_WITHIN_S = 5.0
_SILENT_S = 3.0
"""A client that was silent for so long is replaced by one that connects."""
_UNANSWERED_MS = 5000
"""Data that the peer does not acknowledge for so long counts as lost (TCP_USER_TIMEOUT)."""


class TcpOutLink(ReceivingLink):
    """A TCP client as a link; wall clock only.

    A lost connection is reopened after waits that grow; meanwhile written bytes are lost.
    patient: the server need not listen yet when the link is opened.
    """

    def __init__(
        self, *, address: LinkAddress, back_off: BackOff | None = None, patient: bool = False
    ) -> None:
        self._address = address
        self._patient = patient
        self._peer: StreamPeer | None = None
        self._recovery = Reconnection(
            name=self.name, reconnect=self._connect, back_off=back_off or BackOff()
        )

    @property
    def name(self) -> str:
        """Return the TCP client's link string."""
        return str(self._address)

    @property
    def trouble(self) -> str:
        """Return why the TCP connection is lost; empty while connected."""
        return self._recovery.trouble

    def write(self, data: bytes) -> None:
        """Send bytes on the TCP connection, while connected."""
        if self._peer is not None:
            self._peer.write(data)

    async def __aenter__(self) -> Self:
        """Connect by TCP. Raises LinkError without an answer, unless it is patient."""
        try:
            await self._connect()
        except LinkError as error:
            if not self._patient:
                raise
            self._recovery.lost(str(error).removeprefix(f"{self.name}: "))
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close the TCP connection."""
        self._receiver = None
        await self._recovery.stop()
        await _close(self._peer)
        self._peer = None

    async def _connect(self) -> None:
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(_CONNECT_WITHIN_S):
                await loop.create_connection(self._new_peer, self._address.host, self._address.port)
        except TimeoutError as error:
            raise LinkError(
                f"{self.name}: {self._address.host} does not answer on port {self._address.port} "
                f"within {_CONNECT_WITHIN_S:g} s; is it switched on and on this network?"
            ) from error
        except OSError as error:
            raise LinkError(f"{self.name}: {socket_remedy(error, self._address)}") from error

    def _new_peer(self) -> StreamPeer:
        return StreamPeer(opened=self._on_open, received=self._on_bytes, on_lost=self._on_lost)

    def _on_open(self, peer: StreamPeer) -> None:
        _notice_dead_peers(peer)
        self._peer = peer

    def _on_bytes(self, _peer: StreamPeer, data: bytes, t_s: float) -> None:
        if self._receiver is not None:
            self._receiver(data, t_s)

    def _on_lost(self, _peer: StreamPeer, why: str) -> None:
        self._peer = None
        self._recovery.lost(why)


class TcpInLink(ReceivingLink):
    """A TCP server as a link for a vehicle, or several ground stations; wall clock only.

    clients: how many may be connected. One more is refused, unless one of them has been silent,
    as after a loss that only the client noticed. With several clients only whole MAVLink frames
    are handed on, so that their bytes do not mix; written bytes go to all.
    """

    def __init__(self, *, address: LinkAddress, clients: int = 1) -> None:
        if clients < 1:
            raise ValueError(f"clients is {clients}: no client could connect")
        self._address = address
        self._most = clients
        self._server: asyncio.Server | None = None
        self._peers: dict[StreamPeer, FrameSplitter] = {}
        self._recovery = Reconnection(name=self.name, reconnect=None, back_off=BackOff())
        self._refused = ""

    @property
    def name(self) -> str:
        """Return the TCP server's link string."""
        return str(self._address)

    @property
    def trouble(self) -> str:
        """Return why no TCP client is connected, or which was refused; empty otherwise."""
        if not self._peers:
            return self._recovery.trouble or "no client has connected"
        return self._refused

    @property
    def local_port(self) -> int:
        """Return the TCP server's port; 0 when closed."""
        if self._server is None or not self._server.sockets:
            return 0
        return int(self._server.sockets[0].getsockname()[1])

    def write(self, data: bytes) -> None:
        """Send bytes to the connected TCP clients."""
        for peer in self._peers:
            peer.write(data)

    async def __aenter__(self) -> Self:
        """Listen by TCP. Raises LinkError when port or address cannot be bound."""
        loop = asyncio.get_running_loop()
        host, port = self._address.host, self._address.port
        try:
            self._server = await loop.create_server(self._new_peer, host, port, reuse_address=True)
        except OSError as error:
            # From Python 3.13 on this has no number for an address that is not this machine's.
            failed = error if error.errno else OSError(errno.EADDRNOTAVAIL, str(error))
            raise LinkError(f"{self.name}: {socket_remedy(failed, self._address)}") from error
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close the TCP server and all connections."""
        self._receiver = None
        if self._server is not None:
            self._server.close()
        peers, self._peers = tuple(self._peers), {}
        for peer in peers:
            peer.close()
        if self._server is not None:
            await self._server.wait_closed()
            self._server = None
        await self._recovery.stop()
        # An aborted transport closes its socket one turn later.
        await asyncio.sleep(0)

    def _new_peer(self) -> StreamPeer:
        return StreamPeer(opened=self._on_open, received=self._on_bytes, on_lost=self._on_lost)

    def _on_open(self, peer: StreamPeer) -> None:
        if len(self._peers) >= self._most and not self._make_room(peer.last_received_s):
            self._refused = f"{peer.address} was refused: another client is connected"
            peer.close()
            return
        _notice_dead_peers(peer)
        self._peers[peer] = FrameSplitter()
        self._recovery.back()

    def _make_room(self, now_s: float) -> bool:
        """Close the TCP client that is silent the longest; return whether there was one."""
        oldest = min(self._peers, key=lambda peer: peer.last_received_s)
        if now_s - oldest.last_received_s < _SILENT_S:
            return False
        del self._peers[oldest]
        oldest.close()
        return True

    def _on_bytes(self, peer: StreamPeer, data: bytes, t_s: float) -> None:
        splitter = self._peers.get(peer)
        if splitter is None or self._receiver is None:
            return
        if self._most > 1:
            data = b"".join([frame.raw for frame in splitter.feed(data)])
        if data:
            self._receiver(data, t_s)

    def _on_lost(self, peer: StreamPeer, why: str) -> None:
        if self._peers.pop(peer, None) is not None and not self._peers:
            self._recovery.lost(why)


def tcp_client(request: LinkRequest) -> TcpOutLink:
    """Return the TCP client that is asked for."""
    back_off = _SOON if request.patient else None
    return TcpOutLink(address=request.address, back_off=back_off, patient=request.patient)


def tcp_server(request: LinkRequest) -> TcpInLink:
    """Return the TCP server that is asked for, for one client."""
    return TcpInLink(address=request.address)


async def _close(peer: StreamPeer | None) -> None:
    if peer is not None:
        peer.close()
        # An aborted transport closes its socket one turn later.
        await asyncio.sleep(0)


def _notice_dead_peers(peer: StreamPeer) -> None:
    """Set TCP keep-alive, so that a vanished peer is noticed (Linux)."""
    stream = peer.socket
    if stream is not None and sys.platform.startswith("linux"):
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _UNANSWERED_MS)
