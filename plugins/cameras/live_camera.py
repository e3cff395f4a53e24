"""Live cameras: a thread grabs images, the event loop hands them on.

A device or a network stream can block for long, and decoding takes milliseconds: both happen in
a thread of the source's own. A short queue lies between the thread and the loop; when it is full
the oldest image is dropped.
"""

import asyncio
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal, Protocol, Self

from wil_campaign.plugins.cameras.frame_stamps import FrameStamper, source_counts
from wil_campaign.vehicles.readings import BgrImage, CameraReading, Source
from wil_campaign.vehicles.sources.arrival_clock import ArrivalClock
from wil_campaign.vehicles.sources.camera_source import (
    SourceCounts,
    SourceError,
    SourceStalledError,
)
from wil_campaign.worlds.camera import Intrinsics

_STOP_TIMEOUT_S = 2.0
"""A grabber's thread that has not stopped this long after the request is abandoned."""
_OPENING_MARGIN_S = 2.0
"""How long a grabber may take beyond its time to open: its last read ends, its error says why."""


@dataclass(frozen=True, slots=True)
class GrabbedImage:
    """An image that a grabber got. image_bgr: None when damaged. stamp_s: the sender's stamp."""

    image_bgr: BgrImage | None
    stamp_s: float | None


class Grabber(Protocol):
    """Grabs a live camera's images (protocol); blocking; used by one thread."""

    def open(self) -> None:
        """Open the live camera's device or stream. Raises SourceError."""

    def grab(self) -> GrabbedImage | None:
        """Return the live camera's next image; None after a second without.

        Raises SourceError when the stream has ended.
        """

    def close(self) -> None:
        """Close the live camera; called once, also after an `open` that failed."""


@dataclass(frozen=True, slots=True)
class _ArrivedImage:
    """A grabbed image and when it arrived."""

    grabbed: GrabbedImage
    arrived_s: float


class _Handoff:
    """The queue between the live camera's thread and the loop."""

    def __init__(self, depth: int, wake: Callable[[], None]) -> None:
        self._lock = threading.Lock()
        self._waiting: deque[_ArrivedImage] = deque()
        self._depth = depth
        self._wake = wake
        self._dropped_since_take = 0
        self.error: SourceError | None = None
        self.opened = False

    def put(self, item: _ArrivedImage) -> None:
        """Put a grabbed image into the queue; the oldest is dropped when full."""
        with self._lock:
            if len(self._waiting) >= self._depth:
                self._waiting.popleft()
                self._dropped_since_take += 1
            self._waiting.append(item)
        self._wake()

    def end(self, error: SourceError) -> None:
        self.error = error
        self._wake()

    def ready(self) -> None:
        """Report to the loop that the live camera is open."""
        self.opened = True
        self._wake()

    def receive(self) -> tuple[_ArrivedImage | None, int]:
        """Return the oldest useful image of the queue, and how many were dropped before it."""
        with self._lock:
            dropped, self._dropped_since_take = self._dropped_since_take, 0
            return (self._waiting.popleft() if self._waiting else None), dropped


class LiveCamera:
    """A live camera over a grabber; a CameraSource.

    latency_s: from the middle of the exposure to the arrival of the quickest image, as
    calibrated. rate_hz: the camera's rate, to count exposures that never arrived; None when it
    varies. open_timeout_s, stall_timeout_s: how long the first and each further image is waited
    for. depth: how many images the queue holds.
    """

    kind: Literal["live"] = "live"

    def __init__(
        self,
        *,
        name: str,
        grabber: Grabber,
        intrinsics: Intrinsics,
        side: Source = "real",
        latency_s: float = 0.0,
        rate_hz: float | None = None,
        open_timeout_s: float = 5.0,
        stall_timeout_s: float = 2.0,
        depth: int = 2,
    ) -> None:
        self.name = name
        self.intrinsics = intrinsics
        self._grabber = grabber
        self._open_timeout_s = open_timeout_s
        self._stall_timeout_s = stall_timeout_s
        self._depth = depth
        self._stamper = FrameStamper(
            name=name,
            side=side,
            intrinsics=intrinsics,
            clock=ArrivalClock(latency_s=latency_s),
            rate_hz=rate_hz,
        )
        self._stop = threading.Event()
        self._delivered = 0
        self._dropped = 0
        self._damaged = 0

    @property
    def counts(self) -> SourceCounts:
        """Return the counts of the live camera's exposures so far."""
        return source_counts(
            self._stamper, delivered=self._delivered, dropped=self._dropped, damaged=self._damaged
        )

    async def __aenter__(self) -> Self:
        """Start the live camera's thread and wait until it is open. Raises SourceError."""
        loop = asyncio.get_running_loop()
        self._loop = loop
        self._awake = asyncio.Event()
        self._handoff = _Handoff(self._depth, self._wake)
        self._thread = threading.Thread(
            target=self._run, args=(loop.time,), name=f"camera {self.name}", daemon=True
        )
        self._thread.start()
        try:
            await self._wait_until_open()
        except BaseException:
            await self._close()
            raise
        return self

    async def __aexit__(self, *_: object) -> None:
        """Stop the live camera's thread."""
        await self._close()

    def __aiter__(self) -> Self:
        """Return the live camera itself."""
        return self

    async def __anext__(self) -> CameraReading:
        """Wait for the live camera's next image. Raises SourceError, of its kinds."""
        # Images that cannot be used are none: a stream that is damaged all the time has stalled.
        deadline_s, damaged = self._loop.time() + self._stall_timeout_s, self._damaged
        while True:
            arrived = await self._next_image(deadline_s, damaged)
            reading = self._reading_of(arrived)
            if reading is not None:
                self._delivered += 1
                return reading

    def _reading_of(self, arrived: _ArrivedImage) -> CameraReading | None:
        image_bgr = arrived.grabbed.image_bgr
        if image_bgr is None:
            self._damaged += 1
            self._stamper.skip_exposure()
            return None
        reading = self._stamper.reading(
            image_bgr, stamp_s=arrived.grabbed.stamp_s, arrived_s=arrived.arrived_s
        )
        self._damaged += reading is None
        return reading

    async def _next_image(self, deadline_s: float, damaged: int) -> _ArrivedImage:
        """Wait for an image until a time of the loop. damaged: how many there were before."""
        while True:
            arrived, dropped = self._handoff.receive()
            for _ in range(dropped):
                self._dropped += 1
                self._stamper.skip_exposure()
            if arrived is not None:
                return arrived
            if self._handoff.error is not None:
                raise self._handoff.error
            await self._wait_for_wake(deadline_s, lambda: self._stall_error(damaged))

    async def _wait_until_open(self) -> None:
        opening_s = self._open_timeout_s + _OPENING_MARGIN_S
        while not self._handoff.opened:
            if self._handoff.error is not None:
                raise self._handoff.error
            await self._wait_for_wake(self._loop.time() + opening_s, self._open_error)

    async def _wait_for_wake(self, deadline_s: float, late: Callable[[], SourceError]) -> None:
        try:
            async with asyncio.timeout_at(deadline_s):
                await self._awake.wait()
        except TimeoutError as error:
            raise late() from error
        self._awake.clear()

    def _stall_error(self, damaged: int) -> SourceStalledError:
        """Return the error of a stall. damaged: how many images were, before it began."""
        unusable, others = self._damaged - damaged, ""
        if unusable:
            others = f" ({unusable} incomplete, a second late, or with a time that does not go on)"
        return SourceStalledError(
            f"{self.name}: no image for {self._stall_timeout_s:g} s after "
            f"{self._delivered} images{others}; check the camera's power, cable and network"
        )

    def _open_error(self) -> SourceError:
        return SourceError(
            f"{self.name}: did not open within {self._open_timeout_s:g} s; check that the device "
            "answers other programs"
        )

    def _wake(self) -> None:
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._awake.set)

    async def _close(self) -> None:
        self._stop.set()
        await asyncio.to_thread(self._thread.join, _STOP_TIMEOUT_S)

    def _run(self, clock: Callable[[], float]) -> None:
        handoff = self._handoff
        try:
            self._grabber.open()
            handoff.ready()
            while not self._stop.is_set():
                grabbed = self._grabber.grab()
                if grabbed is not None:
                    handoff.put(_ArrivedImage(grabbed, clock()))
        except SourceError as error:
            handoff.end(error)
        except Exception as error:  # noqa: BLE001 - a thread's error must reach the reader
            handoff.end(SourceError(f"{self.name}: {type(error).__name__}: {error}"))
        finally:
            with suppress(Exception):  # what was taken is whole; one that is gone cannot be closed
                self._grabber.close()
