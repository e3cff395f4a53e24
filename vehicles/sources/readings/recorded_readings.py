"""A recording of a sensor, played from its opening on, in its own time."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal, Protocol, Self, TypeVar

from vehicles.cameras.rendered_cameras import sleep_until
from vehicles.readings import Reading, Source
from vehicles.readings.checks import fault_after, fault_of
from vehicles.sources.camera_source import SourceCounts, SourceError

T = TypeVar("T")


class ReadingFile(Protocol):
    """Reads a recorded sensor's readings (protocol); blocking; used by one thread at a time."""

    @property
    def name(self) -> str:
        """Return the recording's name in messages."""

    @property
    def unusable(self) -> int:
        """Return how many messages were passed over so far, for they are of no use."""

    def open(self) -> None:
        """Open the recording. Raises SourceError."""

    def next(self) -> Reading | None:
        """Return the next reading, stamped as it was; None at the end. Raises SourceError."""

    def close(self) -> None:
        """Close the recording; called once, also after a failed `open`."""


class RecordedReadings:
    """A recorded sensor, played from its opening on; a ReadingSource for any clock.

    latency_s: after its sampling a reading is delivered, at the least; one that was later when it
    was recorded is as late again. What is spoiled in the recording is counted as damaged.
    """

    kind: Literal["file"] = "file"

    def __init__(self, *, file: ReadingFile, side: Source, latency_s: float = 0.0) -> None:
        self.name = file.name
        self._file = file
        self._side: Source = side
        self._latency_s = latency_s
        self._ahead: Reading | None = None
        self._before: Reading | None = None
        self._running: asyncio.Future[Any] | None = None
        self._shift_s = 0.0
        self._seq = -1
        self._delivered = 0
        self._damaged = 0

    @property
    def counts(self) -> SourceCounts:
        """Return the counts of the recorded readings so far."""
        return SourceCounts(delivered=self._delivered, damaged=self._damaged + self._file.unusable)

    async def __aenter__(self) -> Self:
        """Open the recording and read its first reading. Raises SourceError."""
        try:
            await self._in_thread(self._file.open)
            self._ahead = first = await self._first()
        except BaseException:
            await self._close()
            raise
        self._shift_s = asyncio.get_running_loop().time() - first.t_s
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close the recording."""
        await self._close()

    def __aiter__(self) -> Self:
        """Return the recording itself."""
        return self

    async def __anext__(self) -> Reading:
        """Wait for the next recorded reading. Raises SourceError, or StopAsyncIteration."""
        found = self._ahead
        if found is None:
            raise StopAsyncIteration
        self._ahead = await self._next_sound()
        t_s = found.t_s + self._shift_s
        await sleep_until(t_s + max(self._latency_s, found.arrived_s - found.t_s))
        now_s = max(asyncio.get_running_loop().time(), t_s)
        self._seq += 1
        self._delivered += 1
        return replace(found, t_s=t_s, arrived_s=now_s, seq=self._seq, source=self._side)

    async def _first(self) -> Reading:
        """Return the recording's first reading. Raises SourceError without one."""
        if (found := await self._next_sound()) is None:
            raise SourceError(f"{self.name}: has no reading that can be used")
        return found

    async def _next_sound(self) -> Reading | None:
        """Return the next recorded reading without fault; None at the end."""
        while (found := await self._in_thread(self._file.next)) is not None:
            if fault_of(found) is None and fault_after(found, self._before) is None:
                self._before = found
                return found
            self._damaged += 1
        return None

    async def _in_thread(self, job: Callable[[], T]) -> T:
        running = asyncio.get_running_loop().run_in_executor(None, job)
        self._running = running
        return await asyncio.shield(running)

    async def _close(self) -> None:
        # Who reads may have been cancelled while its thread still is at work on the file.
        if self._running is not None and not self._running.done():
            await asyncio.wait({self._running})
        self._file.close()
