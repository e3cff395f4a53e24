"""The socket of a vehicle's feed: a pair between two processes of ours, of which one is inherited.

Nobody else can send to it, nor read it. A child finds the number of its end in `FEED_DESCRIPTOR`.
"""

import asyncio
import os
import socket
from collections.abc import Callable, Mapping

FEED_DESCRIPTOR = "WIL_CAMPAIGN_FEED"
"""The environment variable with the file descriptor of a child's end."""
_PACKET_BYTES = 1 << 16
_PACKETS_A_TURN = 64


def feed_pair() -> tuple[socket.socket, socket.socket]:
    """Return both ends of a feed; one is to be inherited."""
    return socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)


def feed_environment(descriptor: int) -> dict[str, str]:
    """Return the environment variable of a child's end."""
    return {FEED_DESCRIPTOR: str(descriptor)}


def inherited_feed(environment: Mapping[str, str] = os.environ) -> socket.socket | None:
    """Return the end that this process has inherited; None without one."""
    number = environment.get(FEED_DESCRIPTOR)
    return None if number is None else socket.socket(fileno=int(number))


class FeedSocket:
    """One end of a feed in this event loop. take: called with each packet.

    What the other end does not read in time is dropped, the newest first, as by UDP.
    """

    def __init__(self, end: socket.socket, take: Callable[[bytes], None]) -> None:
        self._end = end
        self._take = take
        self._loop = asyncio.get_running_loop()
        end.setblocking(False)
        self._loop.add_reader(end, self._read)

    def send(self, packet: bytes) -> None:
        """Send a packet, unless the other end has closed or reads too slowly."""
        try:
            self._end.send(packet)
        except OSError:
            return

    def close(self) -> None:
        """Close this end."""
        if self._end.fileno() >= 0:
            self._loop.remove_reader(self._end)
        self._end.close()

    def _read(self) -> None:
        for _ in range(_PACKETS_A_TURN):
            try:
                packet = self._end.recv(_PACKET_BYTES)
            except BlockingIOError:
                return
            except OSError:
                packet = b""
            if not packet:
                self._loop.remove_reader(self._end)
                return
            self._take(packet)
