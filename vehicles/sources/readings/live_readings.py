"""A live source of readings: checks and counts arriving readings, and detects stalls."""

import asyncio
from collections import deque
from dataclasses import replace
from typing import Literal, Self

from wil_campaign.vehicles.readings import Reading
from wil_campaign.vehicles.readings.checks import reading_fault
from wil_campaign.vehicles.sources.arrival_clock import RestartMeter
from wil_campaign.vehicles.sources.camera_source import (
    SourceCounts,
    SourceError,
    SourceStalledError,
)

OLDEST_S = 1.0
"""A reading that was sampled longer before its arrival has a stamp of another clock."""
_EARLY_S = 0.05
"""A mapped clock is off by less: a stamp that is later than its arrival by more is wrong."""
_POLL_S = 0.02
_DEPTH = 64
"""Length of the queue of readings: small ones arrive in bursts when the loop was busy."""


class UnusableReadingError(ValueError):
    """A message of a source holds no usable reading; says why, and what to do."""


class LiveReadings:
    """A live source of readings that others feed; a ReadingSource.

    name: of the source in messages. what: the awaited readings, in words. stall_s: how long each
    reading is waited for. remedy: what to do when nothing arrives at all. `offer` and `refuse` are
    called in the loop. A reading that is faulty, older than the one before it, stamped by another
    clock, or of a sender that begins anew all the time is counted as damaged and never handed on;
    a source that sends nothing else stalls.
    """

    kind: Literal["live"] = "live"

    def __init__(self, *, name: str, what: str, stall_s: float, remedy: str = "") -> None:
        self.name = name
        self._what = what
        self._remedy = remedy
        self.newest: Reading | None = None
        """The last usable reading."""
        self.complaint = ""
        """Why the last unusable message was refused."""
        self.missed = 0
        self.restarts = 0
        """How often the sender's clock or its numbers began anew."""
        self._restart_meter = RestartMeter()
        self._restarts_before = 0
        self._stall_s = stall_s
        self._waiting: deque[Reading] = deque()
        self._arrived = asyncio.Event()
        self._last_received_s: float | None = None
        self._seq = -1
        self._delivered = 0
        self._dropped = 0
        self._damaged = 0

    @property
    def counts(self) -> SourceCounts:
        """Return the counts of the live source's readings so far."""
        return SourceCounts(
            self._delivered, self._dropped, self.missed, self._damaged, self.restarts
        )

    async def __aenter__(self) -> Self:
        """Return the live source; its feed is opened by others."""
        return self

    async def __aexit__(self, *_: object) -> None:
        """Do nothing: the live source's feed is closed by others."""

    def __aiter__(self) -> Self:
        """Return the live source itself."""
        return self

    async def __anext__(self) -> Reading:
        """Wait for the live source's next reading. Raises SourceStalledError."""
        loop = asyncio.get_running_loop()
        if self._last_received_s is None:
            self._last_received_s = loop.time()
        while not self._waiting:
            self._arrived.clear()
            try:
                async with asyncio.timeout_at(self._last_received_s + self._stall_s):
                    await self._arrived.wait()
            except TimeoutError as error:
                self._last_received_s = loop.time()
                raise self._stall_error() from error
        self._delivered += 1
        return self._waiting.popleft()

    def offer(self, reading: Reading, *, skipped: int = 0) -> None:
        """Take a reading that has just arrived. skipped: how many before it never arrived."""
        self._seq += 1 + skipped
        self.missed += skipped
        if self.restarts > self._restarts_before:
            self._restarts_before = self.restarts
            self._restart_meter.add(reading.arrived_s)
        if 0.0 < reading.t_s - reading.arrived_s <= _EARLY_S:
            # Sampling cannot be later than arrival.
            reading = replace(reading, t_s=reading.arrived_s)
        if (why := self._fault(reading)) is not None:
            self._damaged += 1
            self.complaint = why
            return
        self.newest = reading = replace(reading, seq=self._seq)
        self._last_received_s = reading.arrived_s
        if len(self._waiting) >= _DEPTH:
            self._waiting.popleft()
            self._dropped += 1
        self._waiting.append(reading)
        self._arrived.set()

    def refuse(self, why: str) -> None:
        """Count an unusable message that has just arrived."""
        self._seq += 1
        self._damaged += 1
        self.complaint = why

    def missing_reading_text(self, within_s: float) -> str:
        """Return the message that no usable reading arrived in time, with the reason or remedy."""
        why = self.complaint or self._silence_reason()
        return f"{self.name}: no usable {self._what} arrived within {within_s:g} s: {why}"

    async def _wait_for_first(self, open_s: float) -> None:
        """Wait for the first usable reading. Raises SourceError."""
        try:
            async with asyncio.timeout(open_s):
                while self.newest is None:  # noqa: ASYNC110 - a socket's reader sets no event
                    await asyncio.sleep(_POLL_S)
        except TimeoutError as error:
            raise SourceError(self.missing_reading_text(open_s)) from error

    def _silence_reason(self) -> str:
        """Return why nothing arrived at all, or what to do, in words."""
        return self._remedy

    def _fault(self, reading: Reading) -> str | None:
        """Return why a reading cannot be used, in words; None when it can."""
        early_s = reading.t_s - reading.arrived_s
        if early_s > _EARLY_S:
            return (
                f"its stamp is {early_s:.3g} s after its arrival: it is not of the clock that "
                "is mapped to the run clock"
            )
        if -early_s > OLDEST_S:
            return (
                f"its stamp is {-early_s:.3g} s before its arrival: the reading is too old, or its "
                "stamp is not of the clock that is mapped to the run clock"
            )
        if self.newest is not None and reading.t_s <= self.newest.t_s:
            return f"its time stamp does not advance: {reading.t_s:.3f} s was received before"
        if why := self._restart_meter.fault(reading.arrived_s):
            return why
        fault = reading_fault(reading)
        return None if fault is None else fault.detail

    def _stall_error(self) -> SourceStalledError:
        why = f" (the last message was refused: {self.complaint})" if self.complaint else ""
        return SourceStalledError(
            f"{self.name}: no {self._what} for {self._stall_s:g} s after {self._delivered} "
            f"readings{why}"
        )
