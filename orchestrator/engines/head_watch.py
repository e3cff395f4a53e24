"""Whether the head of a cluster is there still: Ray ends a program without one after a minute.

It does so by exit status 1, which says of a campaign that a run failed; so this comes before.
"""

import os
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_LOOK_S = 3.0
_SILENT_S = 30.0
_ANSWER_S = 5.0


@contextmanager
def watched_head(
    address: str,
    *,
    look_s: float = _LOOK_S,
    silent_s: float = _SILENT_S,
    end: Callable[[int], object] = os._exit,
) -> Iterator[None]:
    """End this program by exit code 3 once a head has taken no connection for so long.

    As after a SIGKILL, what flies lands, and finished runs are on the disk. address: HOST:PORT.
    """
    over = threading.Event()

    def watch() -> None:
        silent = 0.0
        while not over.wait(look_s) and silent < silent_s:
            silent = 0.0 if _answers(address) else silent + look_s
        if not over.is_set():
            sys.stderr.write(
                f"the head of the Ray cluster at {address} has not answered for {silent_s:g} s: "
                "what flies lands; start it again, and this with --resume\n"
            )
            sys.stderr.flush()
            end(3)

    thread = threading.Thread(target=watch, name="head of the cluster", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()


def _answers(address: str) -> bool:
    host, _, port = address.rpartition(":")
    try:
        with socket.create_connection((host.strip("[]"), int(port)), timeout=_ANSWER_S):
            return True
    except OSError:
        return False
