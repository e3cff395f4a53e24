"""Sends to one open page: views in latest-only slots, all other messages in order, never dropped.

Images have flow control: the page acknowledges each by its number, and at most two per camera are
unacknowledged. Cameras do not wait for each other.
"""

import asyncio
from collections import deque
from typing import Any

import msgspec
from aiohttp import WSMsgType, web

from wil_campaign.foundation.tasks import open_task_group
from wil_campaign.plugins.console.console_access import ConsoleSession
from wil_campaign.plugins.console.feed.feed_messages import ImageView

WINDOW = 2
"""Unacknowledged images per camera."""
MAX_MESSAGE_BYTES = 1024
"""Limit on messages from a page, which are acknowledgements."""
_MOST_QUEUED = 4000
_SEND_S = 5.0
"""A page that does not read for this long is closed; it reconnects."""
_HEAD = 4


class _Acknowledgement(msgspec.Struct, forbid_unknown_fields=True):
    """A page's acknowledgement of an image. ack: its number."""

    ack: int


class SlowPageError(Exception):
    """A page does not read its messages."""


class PageClient:
    """One open page: its WebSocket, and its queues."""

    def __init__(self, socket: web.WebSocketResponse, session: ConsoleSession) -> None:
        self._socket = socket
        self.session = session
        self._ordered: deque[str] = deque()
        self._views: dict[str, str] = {}
        self._images: dict[str, bytes] = {}
        self._unacknowledged: dict[int, str] = {}
        self._sent_images = 0
        self._is_slow = False
        self._woken = asyncio.Event()

    def order(self, text: str) -> None:
        """Queue a message that must arrive; a page that is too slow is closed."""
        if len(self._ordered) < _MOST_QUEUED:
            self._ordered.append(text)
        else:
            self._is_slow = True
        self._woken.set()

    def show(self, key: str, text: str) -> None:
        """Queue a view; it replaces an earlier one that is still queued."""
        self._views[key] = text
        self._woken.set()

    def show_image(self, key: str, data: bytes) -> None:
        """Queue an image; it replaces an earlier one that is still queued."""
        self._images[key] = data
        self._woken.set()

    async def serve(self) -> None:
        """Send and receive until the page is closed."""
        try:
            async with open_task_group() as group:
                sending = group.create_task(self._send(), name="sending to a page")
                group.create_task(self._receive(sending), name="receiving from a page")
        except (SlowPageError, ConnectionError, TimeoutError):
            return

    async def _receive(self, sending: "asyncio.Task[None]") -> None:
        async for message in self._socket:
            number = (
                _parse_acknowledgement(message.data) if message.type is WSMsgType.TEXT else None
            )
            if number not in self._unacknowledged:
                await self._socket.close(code=1008, message=b"only acknowledgements are read")
                break
            del self._unacknowledged[number]
            self._woken.set()
        sending.cancel()

    async def _send(self) -> None:
        while True:
            await self._woken.wait()
            self._woken.clear()
            if self._is_slow:
                raise SlowPageError
            async with asyncio.timeout(_SEND_S):
                await self._send_queued()

    async def _send_queued(self) -> None:
        """Send all that is queued; images only within the window of their camera."""
        while self._ordered:
            await self._socket.send_str(self._ordered.popleft())
        for key in tuple(self._views):
            await self._socket.send_str(self._views.pop(key))
        for key in tuple(self._images):
            if list(self._unacknowledged.values()).count(key) < WINDOW:
                self._sent_images += 1
                self._unacknowledged[self._sent_images] = key
                await self._socket.send_bytes(self._images.pop(key))


def page_json(document: Any) -> str:
    """Return a document as JSON; a number that is not finite becomes null."""
    return msgspec.json.encode(document).decode()


def image_packet(image: ImageView, *, waited_s: float = 0.0) -> bytes:
    """Return an image for the page: the length of its head, the head as JSON, the JPEG.

    waited_s: the time since it was received, which is added to its age.
    """
    head = msgspec.json.encode(
        {
            "run": image.run,
            "name": image.name,
            "seq": image.seq,
            "t_s": image.t_s,
            "age_s": image.age_s + waited_s,
            "width_px": image.width_px,
            "height_px": image.height_px,
            "rendered": image.rendered,
            "alone": image.alone,
        }
    )
    return len(head).to_bytes(_HEAD, "big") + head + image.jpeg


def _parse_acknowledgement(text: str) -> int | None:
    """Return the number of the acknowledged image, from 1; None for an invalid message."""
    try:
        return msgspec.json.decode(text, type=_Acknowledgement).ack
    except msgspec.DecodeError:
        return None
