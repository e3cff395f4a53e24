"""One end of the packet socket between the orchestrator and the guard's process."""

import asyncio
import socket
from collections import deque
from collections.abc import Callable

from safety.guard.messages import Bytes, Message, OnWire, Position
from safety.guard.protocol import LONGEST_MESSAGE_BYTES, ProtocolError, decode, encode

_PACKETS_A_TURN = 64
_BUFFER_BYTES = 1 << 20
_LONGEST_QUEUE = 10_000
_DROPPABLE = (Bytes, Position, OnWire)
"""What is worth nothing when it comes late; all else is kept until the other end reads."""


def channel_pair() -> tuple[socket.socket, socket.socket]:
    """Return the two ends of a packet socket; the kernel keeps packets whole and in order."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for end in (ours, theirs):
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER_BYTES)
    return ours, theirs


class Channel:
    """Sends and receives messages from an event loop, without ever waiting.

    take: called with each message; what cannot be read is counted in `garbage`. closed: called
    once when the other end is gone. To an end that does not read, frames and positions are lost
    and counted in `dropped`; other messages are kept.
    """

    def __init__(
        self,
        end: socket.socket,
        *,
        take: Callable[[Message], None],
        closed: Callable[[], None],
    ) -> None:
        self._socket = end
        self._take = take
        self._closed = closed
        self._kept: deque[bytes] = deque()
        self._open = False
        self.dropped = 0
        self.garbage = 0

    def open(self) -> None:
        """Begin to receive in the running loop."""
        self._socket.setblocking(False)
        self._open = True
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._socket, self._read)

    def close(self) -> None:
        """Stop; `closed` is not called for it."""
        if self._open:
            self._open = False
            self._loop.remove_reader(self._socket)
            self._loop.remove_writer(self._socket)
        self._socket.close()

    def send(self, message: Message) -> None:
        """Send a message; to an end that is gone nothing is sent."""
        if not self._open:
            return
        packet = encode(message)
        if self._kept:
            self._keep(message, packet)
            return
        try:
            self._socket.send(packet)
        except (BlockingIOError, InterruptedError):
            self._keep(message, packet)
        except OSError:
            return  # What it said last is read first; then `_read` finds the end.

    def _keep(self, message: Message, packet: bytes) -> None:
        if isinstance(message, _DROPPABLE) or len(self._kept) >= _LONGEST_QUEUE:
            self.dropped += 1
            return
        if not self._kept:
            self._loop.add_writer(self._socket, self._flush)
        self._kept.append(packet)

    def _flush(self) -> None:
        try:
            while self._kept:
                self._socket.send(self._kept[0])
                self._kept.popleft()
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            self._kept.clear()
        self._loop.remove_writer(self._socket)

    def _read(self) -> None:
        for _ in range(_PACKETS_A_TURN):
            if not self._open:
                return
            try:
                packet = self._socket.recv(LONGEST_MESSAGE_BYTES)
            except (BlockingIOError, InterruptedError):
                return
            except ConnectionResetError:
                continue  # It went without reading all; what it said before comes now.
            except OSError:
                packet = b""
            if not packet:
                self._lose()
                return
            try:
                message = decode(packet)
            except ProtocolError:
                self.garbage += 1
                continue
            self._take(message)

    def _lose(self) -> None:
        if self._open:
            # Later, so that nobody is told in the middle of its own sending.
            self._loop.call_soon(self._closed)
            self._open = False
            self._loop.remove_reader(self._socket)
            self._loop.remove_writer(self._socket)
