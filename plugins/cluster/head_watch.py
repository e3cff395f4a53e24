"""Watches the head of a Ray cluster: Ray ends a program that has lost it after a minute.

Ray does so with exit code 1, which for a campaign means that a run failed; so this ends it earlier.
"""

import os
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

_POLL_S = 3.0
_SILENT_S = 30.0
_CONNECT_S = 5.0
"""A head whose machine is gone refuses nothing: each try takes so long."""
_LEAST_TRIES = 3
"""This program may have stood still (Ctrl-Z) while one try lasted."""


@contextmanager
def watched_head(
    address: str,
    *,
    poll_s: float = _POLL_S,
    silent_s: float = _SILENT_S,
    end: Callable[[int], object] = os._exit,
) -> Iterator[None]:
    """End this program with exit code 3 once the head has accepted no connection for `silent_s`.

    As after a SIGKILL, vehicles land, and finished runs are on the disk. address: HOST:PORT.
    """
    over = threading.Event()

    def watch() -> None:
        accepted_s, tries = time.monotonic(), 0
        while not over.wait(poll_s):
            if _accepts_connection(address):
                accepted_s, tries = time.monotonic(), 0
                continue
            tries += 1
            if tries >= _LEAST_TRIES and time.monotonic() - accepted_s >= silent_s:
                break
        if not over.is_set():
            # Without a terminal it has to end as well.
            with suppress(OSError, ValueError, AttributeError):
                sys.stderr.write(
                    f"the head of the Ray cluster at {address} has not answered for {silent_s:g} "
                    "s: vehicles in flight land; start the head again, then this campaign with "
                    "--resume\n"
                )
                sys.stderr.flush()
            end(3)

    thread = threading.Thread(target=watch, name="watch of the cluster head", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()


def await_head(address: str, limit_s: float = _SILENT_S) -> bool:
    """Wait until a head accepts a connection; return whether it has within `limit_s`.

    address: HOST:PORT. Ray itself tries again and again, for more than ten minutes.
    """
    due_s = time.monotonic() + limit_s
    while not _accepts_connection(address):
        if time.monotonic() >= due_s:
            return False
        time.sleep(min(_POLL_S, max(0.0, due_s - time.monotonic())))
    return True


def _accepts_connection(address: str) -> bool:
    host, _, port = address.rpartition(":")
    try:
        with socket.create_connection((host.strip("[]"), int(port)), timeout=_CONNECT_S):
            return True
    except OSError:
        return False
