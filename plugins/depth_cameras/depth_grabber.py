"""Live depth cameras: a thread grabs images, the event loop takes them as readings."""

import asyncio
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol, Self

from wil_campaign.vehicles.readings import DepthImage, DepthReading
from wil_campaign.vehicles.sources.arrival_clock import ArrivalClock
from wil_campaign.vehicles.sources.camera_source import SourceError
from wil_campaign.vehicles.sources.readings.live_readings import LiveReadings
from wil_campaign.vehicles.sources.source_request import SourceRequest
from wil_campaign.worlds.camera import Intrinsics

_STOP_S = 2.0
"""A thread that has not ended this long after the request is abandoned."""
_OPENING_MARGIN_S = 2.0
"""How long a grabber may take beyond its time to open: its last wait ends, its error says why."""


@dataclass(frozen=True, slots=True)
class GrabbedDepth:
    """A depth image that arrived, or what is wrong with it.

    depth_m: (height, width) float32, metres; None for one that cannot be used, and `why` says so.
    stamp_s: on the sender's clock; None without. skipped: how many before it never arrived.
    """

    depth_m: DepthImage | None
    stamp_s: float | None = None
    skipped: int = 0
    why: str = ""


class DepthGrabber(Protocol):
    """Grabs a depth camera's images (protocol); blocking; used by one thread at a time."""

    def open(self) -> None:
        """Open the depth camera. Raises SourceError."""

    def grab(self) -> GrabbedDepth | None:
        """Return the depth camera's next image; None after a moment without. Raises SourceError."""

    def close(self) -> None:
        """Close the depth camera; called once, also after an `open` that failed."""


def depth_camera_of_request(request: SourceRequest) -> Intrinsics:
    """Return the model of the depth camera that a source is asked for."""
    if request.camera is None:
        raise TypeError(f"{request.address}: a {request.kind} has no camera model")
    return request.camera


class GrabbedReadings(LiveReadings):
    """The readings of a depth camera over a grabber; a ReadingSource. Wall clock only."""

    def __init__(self, *, request: SourceRequest, grabber: DepthGrabber, remedy: str) -> None:
        super().__init__(
            name=f"{request.side} {request.sensor} from {request.address}",
            what="depth image",
            stall_s=request.stall_s,
            remedy=remedy,
        )
        self._request = request
        self._camera = depth_camera_of_request(request)
        self._grabber = grabber
        self._clock = ArrivalClock(latency_s=request.latency_s)
        self._stop = threading.Event()
        self._opened = asyncio.Event()
        self._error: SourceError | None = None

    async def __aenter__(self) -> Self:
        """Open the depth camera, and wait for its first image. Raises SourceError."""
        loop = asyncio.get_running_loop()
        self._thread = threading.Thread(
            target=self._run, args=(loop,), name=f"depth {self.name}", daemon=True
        )
        self._thread.start()
        try:
            await self._wait_until_open()
            await self._wait_for_first(self._request.open_s)
        except BaseException:
            await self.__aexit__()
            raise
        return self

    async def __aexit__(self, *_: object) -> None:
        """Stop the depth camera's thread, which closes it."""
        self._stop.set()
        await asyncio.to_thread(self._thread.join, _STOP_S)

    async def _wait_until_open(self) -> None:
        open_s = self._request.open_s
        try:
            async with asyncio.timeout(open_s + _OPENING_MARGIN_S):
                await self._opened.wait()
        except TimeoutError as error:
            raise SourceError(
                f"{self.name}: did not open within {open_s:g} s; check that the device answers "
                "other programs"
            ) from error
        if self._error is not None:
            raise self._error

    def _run(self, loop: asyncio.AbstractEventLoop) -> None:
        try:
            self._grabber.open()
            _call(loop, self._opened.set)
            while not self._stop.is_set():
                if (grabbed := self._grabber.grab()) is not None:
                    _call(loop, self._receive, grabbed, loop.time())
        except Exception as error:  # noqa: BLE001 - a thread's error must reach the reader
            why = f"{self.name}: {type(error).__name__}: {error}"
            self._error = error if isinstance(error, SourceError) else SourceError(why)
            _call(loop, self.refuse, str(self._error))
            _call(loop, self._opened.set)
        finally:
            with suppress(Exception):  # what was taken is whole; one that is gone cannot be closed
                self._grabber.close()

    def _receive(self, grabbed: GrabbedDepth, arrived_s: float) -> None:
        """Take an image that arrived at a time of the run clock."""
        if grabbed.depth_m is None:
            self.refuse(grabbed.why)
            return
        t_s = self._clock.run_time(grabbed.stamp_s, arrived_s)
        self.restarts = self._clock.resets
        reading = DepthReading(
            t_s=t_s,
            arrived_s=arrived_s,
            seq=0,
            source=self._request.side,
            depth_m=grabbed.depth_m,
            intrinsics=self._camera,
            rendered=False,
            mount=self._request.mount,
        )
        self.offer(reading, skipped=grabbed.skipped)


def _call(loop: asyncio.AbstractEventLoop, function: Callable[..., None], *given: Any) -> None:
    """Call a function in a loop, unless that has ended; from a thread."""
    with suppress(RuntimeError):
        loop.call_soon_threadsafe(function, *given)
