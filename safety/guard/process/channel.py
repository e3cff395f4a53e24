"""One end of the packet socket between the orchestrator and the guard's process."""

import asyncio
import socket
from collections import deque
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

from wil_campaign.foundation.clocks.paced_loop import call_wall_later
from wil_campaign.foundation.processes.codec import (
    MessageCodec,
    ProcessMessage,
    ProcessMessageError,
)
from wil_campaign.safety.guard.process.messages import FrameBytes, FrameSent, VehiclePosition

_BUFFER_BYTES = 1 << 20
LONGEST_PACKET_BYTES = 1 << 17
_LONGEST_QUEUE = 10_000
_DROPPABLE = (FrameBytes, VehiclePosition, FrameSent)
"""What is worth nothing when it comes late; all else is kept until the other end reads."""


def guard_channel_pair() -> tuple[socket.socket, socket.socket]:
    """Return the two ends of a channel's packet socket; packets stay whole and in order."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for end in (ours, theirs):
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER_BYTES)
    return ours, theirs


Received = TypeVar("Received", bound=ProcessMessage)


class GuardChannel(Generic[Received]):
    """The message channel between guard process and orchestrator; it never blocks.

    receives: the messages of the other end. take: called with each of them; packets that cannot
    be read are counted in `garbage`. closed: called once when the other end is gone. To an end
    that does not read, frames and positions are lost and counted in `dropped`; other messages are
    kept.
    """

    def __init__(
        self,
        end: socket.socket,
        *,
        receives: MessageCodec[list[Received]],
        take: Callable[[Received], None],
        closed: Callable[[], None],
    ) -> None:
        self._socket = end
        self._packet = memoryview(bytearray(LONGEST_PACKET_BYTES))
        self._codec = receives
        self._take = take
        self._closed = closed
        self._on_lost: list[Callable[[ProcessMessage], None]] = []
        self._unsent: deque[bytes] = deque()
        self._waiting: dict[Hashable, ProcessMessage] = {}
        self._flush_timer: asyncio.Handle | None = None
        self._open = False
        self.dropped = 0
        self.garbage = 0

    def open(self) -> None:
        """Start to receive on the channel in the running loop."""
        self._socket.setblocking(False)
        self._open = True
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._socket, self._read_packet)

    def on_lost(self, listener: Callable[[ProcessMessage], None]) -> None:
        """Register a listener for each message that is lost on the channel."""
        self._on_lost.append(listener)

    @property
    def congested(self) -> bool:
        """Return whether messages wait until the other end reads."""
        return bool(self._unsent)

    def read_rest(self) -> None:
        """Take what an end that is gone has sent: it would be lost by closing."""
        while self._open and self._read_packet():
            pass

    def close(self) -> None:
        """Close the channel; `closed` is not called for it."""
        if self._flush_timer is not None:
            self._flush_timer.cancel()
        if self._open:
            self._open = False
            self._loop.remove_reader(self._socket)
            self._loop.remove_writer(self._socket)
        self._socket.close()

    def send(
        self, message: ProcessMessage, *, last: bool = False, replaces: Hashable | None = None
    ) -> None:
        """Send a message on the channel, and what waits; nothing to an end that is gone.

        last: what waits is to be taken before it. replaces: the key of what need not be sent now.
        """
        if not self._waiting:
            self._send([message])
            return
        self._waiting.pop(replaces, None)
        waiting = self._take_waiting()
        self._send([*waiting, message] if last else [message, *waiting])

    def send_soon(self, message: ProcessMessage, *, key: Hashable, within_s: float) -> None:
        """Send a message on the channel with the next one, or after so much wall time.

        It takes the place of one with the same key that still waits.
        """
        if not self._open:
            return
        self._waiting.pop(key, None)
        self._waiting[key] = message
        if self._flush_timer is None:
            self._flush_timer = call_wall_later(within_s, self._flush)

    def _flush(self) -> None:
        self._send(self._take_waiting())

    def _take_waiting(self) -> list[ProcessMessage]:
        if self._flush_timer is not None:
            self._flush_timer.cancel()
            self._flush_timer = None
        waiting = list(self._waiting.values())
        self._waiting.clear()
        return waiting

    def _send(self, messages: list[ProcessMessage]) -> None:
        if not self._open or not messages:
            return
        packet = self._codec.encode(messages)
        if len(packet) > LONGEST_PACKET_BYTES:
            raise ProcessMessageError(f"a packet of {len(packet)} bytes is too long")
        if self._unsent:
            self._keep(messages, packet)
            return
        try:
            self._socket.send(packet)
        except (BlockingIOError, InterruptedError):
            self._keep(messages, packet)
        except OSError:
            return  # What it sent last is read first; then `_read` finds the end.

    def _keep(self, messages: list[ProcessMessage], packet: bytes) -> None:
        undroppable = [one for one in messages if not isinstance(one, _DROPPABLE)]
        self.dropped += len(messages) - len(undroppable)
        for listener in self._on_lost:
            for message in messages:
                if isinstance(message, _DROPPABLE):
                    listener(message)
        if not undroppable:
            return
        if len(self._unsent) >= _LONGEST_QUEUE:
            self.dropped += len(undroppable)
            return
        if not self._unsent:
            self._loop.add_writer(self._socket, self._send_kept)
        self._unsent.append(
            packet if len(undroppable) == len(messages) else self._codec.encode(undroppable)
        )

    def _send_kept(self) -> None:
        try:
            while self._unsent:
                self._socket.send(self._unsent[0])
                self._unsent.popleft()
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            self._unsent.clear()
        self._loop.remove_writer(self._socket)

    def _read_packet(self) -> bool:
        """Read one packet; return whether there was one.

        The loop comes back for the next, and mostly there is none.

        Asking for one that is not there would cost an exception each time. The buffer is kept: to
        allocate it would cost more than to read.
        """
        try:
            length = self._socket.recv_into(self._packet)
        except (BlockingIOError, InterruptedError):
            return False
        except ConnectionResetError:
            return True  # It went without reading all; what it sent before comes next.
        except OSError:
            length = 0
        if not length:
            self._lose()
            return False
        try:
            messages = self._codec.decode(self._packet[:length])
        except ProcessMessageError:
            self.garbage += 1
            return True
        for message in messages:
            self._take(message)
        return True

    def _lose(self) -> None:
        if self._open:
            # Later, so that no sender is called back in the middle of its own sending.
            self._loop.call_soon(self._closed)
            self._open = False
            self._loop.remove_reader(self._socket)
            self._loop.remove_writer(self._socket)
