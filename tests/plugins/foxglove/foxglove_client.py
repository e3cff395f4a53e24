"""Clients of the Foxglove WebSocket protocol (foxglove.sdk.v1), by a plain WebSocket."""

import asyncio
import json
import socket
import struct
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any

import aiohttp

PROTOCOL = "foxglove.sdk.v1"
PATIENCE_S = 60.0
_MESSAGE, _TIME = 1, 2
_HEAD = struct.Struct("<BIQ")
_REFUSED_REQUEST = {
    "op": "advertise",
    "channels": [{"id": 1, "topic": "/cmd", "encoding": "json", "schemaName": ""}],
}
"""The server answers it by a status: what the client sent before has been done by then."""


@dataclass(slots=True)
class Received:
    """What a client got: the server's greetings, its channels, and the messages of each topic."""

    greetings: list[dict[str, Any]] = field(default_factory=list)
    statuses: list[dict[str, Any]] = field(default_factory=list)
    channels: dict[int, dict[str, Any]] = field(default_factory=dict)
    messages: dict[str, list[tuple[int, dict[str, Any]]]] = field(default_factory=dict)
    times_ns: list[int] = field(default_factory=list)
    is_greeted: threading.Event = field(default_factory=threading.Event)
    subscribed: set[str] = field(default_factory=set)
    """The topics that the server sends."""
    asked: deque[set[str]] = field(default_factory=deque)
    """The topics of each request that the server has not answered."""

    def of(self, topic: str) -> list[dict[str, Any]]:
        return [document for _, document in self.messages.get(topic, [])]

    def has(self, topic: str, *, name: str = "", text: str = "") -> bool:
        """Wait for a line of a log, or for any message of a topic; False where none comes."""
        give_up_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < give_up_s:
            if any(
                not name or (one["name"], one["message"]) == (name, text) for one in self.of(topic)
            ):
                return True
            time.sleep(0.01)
        return False

    def has_subscribed(self, topic: str) -> bool:
        """Wait until the server sends a topic; False where it does not."""
        give_up_s = time.monotonic() + PATIENCE_S
        while topic not in self.subscribed and time.monotonic() < give_up_s:
            time.sleep(0.01)
        return topic in self.subscribed

    def take(self, message: aiohttp.WSMessage) -> list[int]:
        """Take a message; return the channels that are new."""
        if message.type is aiohttp.WSMsgType.BINARY:
            self._take_binary(message.data)
            return []
        said = json.loads(message.data)
        if said["op"] == "serverInfo":
            self.greetings.append(said)
        if said["op"] == "status":
            self.statuses.append(said)
            self.subscribed |= self.asked.popleft()
        new = said["channels"] if said["op"] == "advertise" else []
        if new:
            # With its greeting alone it may not be among those yet who hear of another run.
            self.is_greeted.set()
        self.channels |= {one["id"]: one for one in new}
        return [one["id"] for one in new]

    def _take_binary(self, data: bytes) -> None:
        if data[0] == _TIME:
            self.times_ns.append(int.from_bytes(data[1:9], "little"))
            return
        kind, subscription, log_ns = _HEAD.unpack_from(data)
        assert kind == _MESSAGE
        topic = self.channels[subscription]["topic"]
        self.messages.setdefault(topic, []).append((log_ns, json.loads(data[_HEAD.size :])))


@contextmanager
def listening(url: str) -> Iterator[Received]:
    """Subscribe to all topics in a thread until the context is left."""
    received, is_over = Received(), threading.Event()

    async def listen() -> None:
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(url, protocols=[PROTOCOL], max_msg_size=0) as end,
        ):
            assert end.protocol == PROTOCOL
            while not is_over.is_set():
                with suppress(TimeoutError):
                    message = await end.receive(timeout=0.1)
                    if message.type not in {aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY}:
                        return
                    if new := received.take(message):
                        wanted = [{"id": one, "channelId": one} for one in new]
                        await end.send_json({"op": "subscribe", "subscriptions": wanted})
                        received.asked.append({received.channels[one]["topic"] for one in new})
                        await end.send_json(_REFUSED_REQUEST)

    thread = threading.Thread(target=lambda: asyncio.run(listen()))
    thread.start()
    try:
        assert received.is_greeted.wait(PATIENCE_S)
        yield received
    finally:
        is_over.set()
        thread.join(PATIENCE_S)


@contextmanager
def never_reading(port: int, *, channels: int) -> Iterator[None]:
    """Have a client that subscribes to channels 1 and up, and takes nothing from its socket."""
    with socket.socket() as end:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        end.connect(("127.0.0.1", port))
        end.sendall(
            f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n"
            "Connection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
            f"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: {PROTOCOL}\r\n\r\n".encode()
        )
        assert end.recv(4096).startswith(b"HTTP/1.1 101 ")
        wanted = [{"id": one, "channelId": one} for one in range(1, channels + 1)]
        text = json.dumps({"op": "subscribe", "subscriptions": wanted}).encode()
        # Masked by zeros: RFC 6455 asks clients to mask, and zeros change nothing.
        end.sendall(b"\x81\xfe" + len(text).to_bytes(2, "big") + bytes(4) + text)
        yield
