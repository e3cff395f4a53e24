"""Sockets of the live feed: each console has a datagram socket in this user's runtime folder."""

import contextlib
import os
import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from wil_campaign.safety.guard.process.runtime_folder import (
    open_runtime_folder,
    runtime_folders,
    sweep_runtime_folder,
)

_SOCKET = re.compile(r"console-[0-9]{1,10}\.sock")
_RECEIVE_BYTES = 1 << 20


def find_console_sockets() -> frozenset[Path]:
    """Return the socket paths of this user's consoles on this machine."""
    found: set[Path] = set()
    for folder in runtime_folders():
        with contextlib.suppress(OSError), os.scandir(folder) as entries:
            found.update(Path(entry.path) for entry in entries if _SOCKET.fullmatch(entry.name))
    return frozenset(found)


@contextmanager
def feed_receiver() -> Iterator[socket.socket]:
    """Open the socket at which this process receives live feeds. Raises OSError."""
    folder = open_runtime_folder().path
    sweep_runtime_folder(folder)
    path = folder / f"console-{os.getpid()}.sock"
    path.unlink(missing_ok=True)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as end:
        end.setblocking(False)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BYTES)
        before = os.umask(0o177)
        try:
            end.bind(str(path))
        finally:
            os.umask(before)
        try:
            yield end
        finally:
            path.unlink(missing_ok=True)


class FeedSender:
    """Sends the live feed to one console without blocking. Raises OSError if the socket is gone."""

    def __init__(self, path: Path) -> None:
        self._end = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._end.setblocking(False)
        try:
            self._end.connect(str(path))
        except OSError:
            self._end.close()
            raise

    def send(self, datagram: bytes) -> bool:
        """Send a datagram; return False where the console's queue is full."""
        try:
            self._end.send(datagram)
        except BlockingIOError:
            return False
        return True

    def close(self) -> None:
        """Close the sender."""
        self._end.close()
