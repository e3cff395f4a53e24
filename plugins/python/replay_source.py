"""A recorded run as a source of readings, delivered at their recorded times on the run clock."""

import asyncio
from collections.abc import AsyncIterator, Collection, Iterator
from pathlib import Path

from wil_campaign.plugins.python.mcap_reader import RecordedReading, Recording
from wil_campaign.vehicles.readings import Reading, Source

Delivered = tuple[str, Reading]
"""The sensor's name, and its reading."""


class ReplaySource:
    """Replays a recording's readings in the order and at the times of their delivery.

    sources, sensors: only these; None for all sensors. offset_s: added to the times at
    which readings are delivered, not to the readings. exact_only: raises ValueError at the first
    image that was recorded with loss, since a mixing replayed from it would diverge. One chunk of
    the file is held in memory. Raises as `Recording` does.
    """

    def __init__(
        self,
        path: Path,
        *,
        sources: Collection[Source] = ("real", "twin"),
        sensors: Collection[str] | None = None,
        offset_s: float = 0.0,
        exact_only: bool = False,
    ) -> None:
        self._path = path
        self._sources = sources
        self._sensors = sensors
        self._offset_s = offset_s
        self._exact_only = exact_only
        self._due_s = float("-inf")
        self._items = self._select_readings(Recording(path))
        self._next = next(self._items, None)

    @property
    def next_due_s(self) -> float | None:
        """Return when the next replayed reading is due on the run clock; None at the end."""
        if self._next is None:
            return None
        # a reading that was delivered late, after a newer one, is due together with it
        return max(self._due_s, self._next[1].arrived_s + self._offset_s)

    def take(self, now_s: float) -> list[Delivered]:
        """Return the replayed readings due by now_s, in order of delivery."""
        due: list[Delivered] = []
        while (due_s := self.next_due_s) is not None and not due_s > now_s:
            if self._next is not None:
                due.append(self._next)
            self._due_s = due_s
            self._next = next(self._items, None)
        return due

    async def __aiter__(self) -> AsyncIterator[Delivered]:
        """Replay readings on the running loop's clock."""
        loop = asyncio.get_running_loop()
        while (due_s := self.next_due_s) is not None:
            if due_s > loop.time():
                await asyncio.sleep(due_s - loop.time())
            for delivered in self.take(max(due_s, loop.time())):
                yield delivered

    def _select_readings(self, recording: Recording) -> Iterator[Delivered]:
        for item in recording:
            if not isinstance(item, RecordedReading):
                continue
            if item.reading.source not in self._sources:
                continue
            if self._sensors is not None and item.sensor not in self._sensors:
                continue
            if self._exact_only and not item.exact:
                raise ValueError(
                    f"{self._path}: images of {item.sensor} are JPEG; a replay from them would"
                    " diverge: record with pictures `raw` or `png`"
                )
            yield (item.sensor, item.reading)
