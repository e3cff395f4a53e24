"""What one open page is sent: views by a latest-only slot each, the rest in order, never dropped.

Images wait for the page: it acknowledges each by its number, and of each camera at most two are on
their way. One camera's image waits for no other's.
"""

import asyncio
from collections import deque
from typing import Any

import msgspec
from aiohttp import WSMsgType, web

from orchestrator.console.console_access import Session
from orchestrator.live_feed.feed_messages import ImageView
from vehicles.tasks import together

WINDOW = 2
"""Images of one camera that are on their way to a page."""
MAX_MESSAGE_BYTES = 1024
"""Of what a page sends by its WebSocket: acknowledgements."""
_MOST_WAITING = 4000
_SEND_S = 5.0
"""A page that takes nothing for so long is closed; it connects again."""
_HEAD = 4


class _Acknowledgement(msgspec.Struct, forbid_unknown_fields=True):
    """What a page sends."""

    ack: int


class SlowPageError(Exception):
    """A page that does not read what it is sent."""


class PageClient:
    """One open page: its WebSocket, and what waits to be sent to it."""

    def __init__(self, socket: web.WebSocketResponse, session: Session) -> None:
        self._socket = socket
        self.session = session
        self._ordered: deque[str] = deque()
        self._views: dict[str, str] = {}
        self._images: dict[str, bytes] = {}
        self._on_way: dict[int, str] = {}
        self._sent_images = 0
        self._is_slow = False
        self._woken = asyncio.Event()

    def order(self, text: str) -> None:
        """Send a document in order, and never drop it; a page that is too slow is closed."""
        if len(self._ordered) < _MOST_WAITING:
            self._ordered.append(text)
        else:
            self._is_slow = True
        self._woken.set()

    def show(self, key: str, text: str) -> None:
        """Send a view in place of an earlier one that still waits."""
        self._views[key] = text
        self._woken.set()

    def show_image(self, key: str, data: bytes) -> None:
        """Send an image in place of an earlier one that still waits."""
        self._images[key] = data
        self._woken.set()

    async def serve(self) -> None:
        """Send and receive until the page is closed."""
        try:
            async with together() as group:
                sending = group.create_task(self._send(), name="sending to a page")
                group.create_task(self._receive(sending), name="reading of a page")
        except (SlowPageError, ConnectionError, TimeoutError):
            return

    async def _receive(self, sending: "asyncio.Task[None]") -> None:
        async for message in self._socket:
            number = _acknowledged(message.data) if message.type is WSMsgType.TEXT else None
            if number not in self._on_way:
                await self._socket.close(code=1008, message=b"only acknowledgements are read")
                break
            del self._on_way[number]
            self._woken.set()
        sending.cancel()

    async def _send(self) -> None:
        while True:
            await self._woken.wait()
            self._woken.clear()
            if self._is_slow:
                raise SlowPageError
            async with asyncio.timeout(_SEND_S):
                await self._send_waiting()

    async def _send_waiting(self) -> None:
        """Send all that waits; of each camera's images no more than the window has room for."""
        while self._ordered:
            await self._socket.send_str(self._ordered.popleft())
        for key in tuple(self._views):
            await self._socket.send_str(self._views.pop(key))
        for key in tuple(self._images):
            if list(self._on_way.values()).count(key) < WINDOW:
                self._sent_images += 1
                self._on_way[self._sent_images] = key
                await self._socket.send_bytes(self._images.pop(key))


def as_text(document: Any) -> str:
    """Return a document as JSON; a number that is not finite becomes null."""
    return msgspec.json.encode(document).decode()


def image_packet(image: ImageView) -> bytes:
    """Return an image for the page: the length of its head, the head as JSON, the JPEG."""
    head = msgspec.json.encode(
        {
            "run": image.run,
            "name": image.name,
            "seq": image.seq,
            "t_s": image.t_s,
            "age_s": image.age_s,
            "width_px": image.width_px,
            "height_px": image.height_px,
            "rendered": image.rendered,
            "alone": image.alone,
        }
    )
    return len(head).to_bytes(_HEAD, "big") + head + image.jpeg


def _acknowledged(text: str) -> int | None:
    """Return the number of the image that a page acknowledges, counted from 1; None for none."""
    try:
        return msgspec.json.decode(text, type=_Acknowledgement).ack
    except msgspec.DecodeError:
        return None
