"""What stands in for a simulator: a socket on a thread that replies as a test wants."""

import threading
from collections.abc import Callable
from typing import Any, Self

import msgpack  # type: ignore[import-untyped]  # ships no types
import zmq

Reply = Callable[[dict[str, Any]], list[bytes]]


class Replier:
    """Replies to each request by `reply`, at `address`; a context manager."""

    def __init__(self, reply: Reply) -> None:
        self._reply = reply
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.REP)
        self.address = f"tcp://127.0.0.1:{self._socket.bind_to_random_port('tcp://127.0.0.1')}"
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._context.destroy(linger=0)

    def _serve(self) -> None:
        while not self._stop.is_set():
            if self._socket.poll(10):
                self._socket.send_multipart(self._reply(msgpack.unpackb(self._socket.recv())))
