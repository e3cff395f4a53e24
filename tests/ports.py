"""Ports for tests, in one place."""

import os
import socket
from collections.abc import Iterator
from functools import cache
from itertools import cycle, islice

_FIRST, _WORKERS, _PAIRS = 20_000, 20, 300


def free_port() -> int:
    """Return an even port of loopback that is free, and the next one with it, by UDP and TCP.

    It is below those that the kernel gives to whoever connects or binds port 0, and each worker of
    pytest-xdist has its own: until the test binds it nobody else gets it.
    """
    for port in islice(_ports(), _PAIRS):
        if _is_free(port) and _is_free(port + 1):
            return port
    raise OSError(f"none of {_PAIRS} ports from {_FIRST} on is free")


@cache
def _ports() -> Iterator[int]:
    """Yield this worker's even ports in turn; another session of tests begins elsewhere."""
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")) % _WORKERS
    first, begun = _FIRST + 2 * _PAIRS * worker, os.getpid()
    return cycle([first + 2 * ((begun + k) % _PAIRS) for k in range(_PAIRS)])


def _is_free(port: int) -> bool:
    for kind in (socket.SOCK_DGRAM, socket.SOCK_STREAM):
        with socket.socket(socket.AF_INET, kind) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, kind == socket.SOCK_STREAM)
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                return False
    return True
