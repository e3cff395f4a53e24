"""Plays a recording of a sensor from its opening on, in its own time."""

import asyncio
from dataclasses import replace
from typing import Protocol, Self

from wil_campaign.foundation.clocks.sleeping import sleep_until
from wil_campaign.vehicles.readings import Reading, Source
from wil_campaign.vehicles.readings.checks import reading_fault, reading_fault_after
from wil_campaign.vehicles.readings.faults import ReadingFault
from wil_campaign.vehicles.sources.camera_source import SourceCounts, SourceError
from wil_campaign.vehicles.sources.file_player import FilePlayer, PlayedFile

_MOST_FAULTY = 20_000
"""A source of a plugin may have no end: then the run would stand still, and be killed for that."""


class ReadingFile(PlayedFile, Protocol):
    """Reads a recorded sensor's readings (protocol)."""

    @property
    def unusable(self) -> int:
        """Return how many unusable messages were skipped so far."""

    def next(self) -> Reading | None:
        """Return the next reading, stamped as it was; None at the end. Raises SourceError."""


class RecordedReadings(FilePlayer[ReadingFile]):
    """A recorded sensor, played from its opening on; a ReadingSource for any clock.

    latency_s: the least time from a reading's sampling to its delivery; one that was later when
    it was recorded is as late again. Faulty readings are counted as damaged.
    """

    def __init__(self, *, file: ReadingFile, side: Source, latency_s: float = 0.0) -> None:
        self.name = file.name
        super().__init__(file)
        self._side: Source = side
        self._latency_s = latency_s
        self._next_reading: Reading | None = None
        self._previous: Reading | None = None
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
            self._next_reading = first = await self._read_first()
        except BaseException:
            await self._close()
            raise
        self._shift_s = asyncio.get_running_loop().time() - first.t_s
        return self

    async def __anext__(self) -> Reading:
        """Wait for the next recorded reading. Raises SourceError, or StopAsyncIteration."""
        reading = self._next_reading
        if reading is None:
            raise StopAsyncIteration
        self._next_reading = await self._read_next_faultless()
        t_s = reading.t_s + self._shift_s
        await sleep_until(t_s + max(self._latency_s, reading.arrived_s - reading.t_s))
        now_s = max(asyncio.get_running_loop().time(), t_s)
        self._seq += 1
        self._delivered += 1
        return replace(reading, t_s=t_s, arrived_s=now_s, seq=self._seq, source=self._side)

    async def _read_first(self) -> Reading:
        if (reading := await self._read_next_faultless()) is None:
            raise SourceError(f"{self.name}: has no usable reading")
        return reading

    async def _read_next_faultless(self) -> Reading | None:
        """Return the next recorded reading without fault; None at the end. Raises SourceError."""
        fault: ReadingFault | None = None
        for _ in range(_MOST_FAULTY):
            if (reading := await self._in_thread(self._file.next)) is None:
                return None
            fault = reading_fault(reading) or reading_fault_after(reading, self._previous)
            if fault is None:
                self._previous = reading
                return reading
            self._damaged += 1
        many = f"{_MOST_FAULTY:,} readings in a row are of no use"
        raise SourceError(f"{self.name}: {many}, the last: {fault.detail if fault else ''}")
