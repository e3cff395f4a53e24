"""Image delivery in a separate thread: encoding takes milliseconds, and a socket may block."""

import asyncio
import threading
from collections import deque
from collections.abc import Callable
from typing import Any, Protocol, Self

from wil_campaign.plugins.outlets.image_delivery import DeliveryCounts, DeliveryError
from wil_campaign.vehicles.readings import Reading

_CLOSING_LIMIT_S = 2.0


class DeliverySink(Protocol):
    """A sink of a threaded delivery (protocol): sends images; blocking; used by one thread."""

    @property
    def name(self) -> str:
        """Return the sink's name in messages."""

    def open(self) -> None:
        """Open the sink. Raises DeliveryError."""

    def write(self, reading: Any, /) -> None:
        """Send one reading, of a type that the sink takes. Raises DeliveryError."""

    def close(self) -> None:
        """Close the sink; called once, also after a failed `open`."""


class ThreadedDelivery:
    """A Delivery to a sink in a thread; for the wall clock only.

    depth: how many images may wait; a further one replaces the oldest.
    """

    def __init__(self, *, sink: DeliverySink, depth: int = 2) -> None:
        self.name = sink.name
        self._sink = sink
        self._depth = depth
        self._waiting: deque[Reading] = deque()
        self._change = threading.Condition()
        self._closing = self._closed = self._sending = False
        self._offered = self._delivered = self._dropped = self._failed = 0
        self._trouble = ""

    @property
    def counts(self) -> DeliveryCounts:
        """Return the threaded delivery's counts so far."""
        with self._change:
            return DeliveryCounts(self._offered, self._delivered, self._dropped, self._failed)

    @property
    def trouble(self) -> str:
        """Return why the last image, or else closing the sink, failed; empty when nothing has."""
        return self._trouble

    def deliver(self, reading: Reading) -> None:
        """Queue an image for the thread; the oldest waiting one is dropped if full."""
        with self._change:
            self._offered += 1
            if self._closed:
                self._dropped += 1
                return
            if len(self._waiting) >= self._depth:
                self._waiting.popleft()
                self._dropped += 1
            self._waiting.append(reading)
            self._change.notify()

    async def __aenter__(self) -> Self:
        """Start the thread and wait until its sink is open. Raises DeliveryError."""
        loop = asyncio.get_running_loop()
        opened: asyncio.Future[None] = loop.create_future()

        def set_opened(error: DeliveryError | None) -> None:
            if opened.done():
                return
            if error is None:
                opened.set_result(None)
            else:
                opened.set_exception(error)

        self._thread = threading.Thread(
            target=self._run,
            args=(lambda error: loop.call_soon_threadsafe(set_opened, error),),
            name=f"delivery {self.name}",
            daemon=True,
        )
        self._thread.start()
        try:
            await opened
        except BaseException:
            await self._close()
            raise
        return self

    async def __aexit__(self, *_: object) -> None:
        """Send images that still wait, and end the thread; it counts those not sent in time."""
        await self._close()

    async def _close(self) -> None:
        with self._change:
            self._closing = True
            self._change.notify()
        try:
            await asyncio.to_thread(self._thread.join, _CLOSING_LIMIT_S)
        finally:
            self._give_up()

    def _give_up(self) -> None:
        """Count images that are not sent as lost; what the thread does later counts no more."""
        with self._change:
            self._closed = True
            self._dropped += len(self._waiting)
            self._waiting.clear()
            if self._sending:
                self._failed += 1
                self._trouble = (
                    f"{self.name}: an image was not sent within {_CLOSING_LIMIT_S:g} s of closing; "
                    "check the receiver"
                )

    def _run(self, opened: Callable[[DeliveryError | None], object]) -> None:
        try:
            self._sink.open()
        except DeliveryError as error:
            opened(error)
        except Exception as error:  # noqa: BLE001 - __aenter__ waits for the result
            opened(DeliveryError(f"{self.name}: {type(error).__name__}: {error}"))
        else:
            opened(None)
            while (reading := self._next_reading()) is not None:
                self._send(reading)
        finally:
            self._close_sink()

    def _close_sink(self) -> None:
        try:
            self._sink.close()
        except Exception as error:  # noqa: BLE001 - a thread's error must reach the result
            text = f"{self.name}: cannot be closed: {type(error).__name__}: {error}"
            self._trouble = self._trouble or text

    def _next_reading(self) -> Reading | None:
        with self._change:
            while not self._waiting and not self._closing:
                self._change.wait()
            self._sending = bool(self._waiting)
            return self._waiting.popleft() if self._waiting else None

    def _send(self, reading: Reading) -> None:
        trouble: str | None = None
        try:
            self._sink.write(reading)
        except DeliveryError as error:
            trouble = str(error)
        except Exception as error:  # noqa: BLE001 - one bad image must not end the delivery
            trouble = f"{self.name}: {type(error).__name__}: {error}"
        with self._change:
            self._sending = False
            if self._closed:
                return
            if trouble is not None:
                self._failed += 1
                self._trouble = trouble
            else:
                self._delivered += 1
