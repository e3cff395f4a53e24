"""A loop whose clock runs faster or slower than the wall's: all that it counts is counted so."""

import asyncio
import selectors
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from heapq import heappop, heappush

from vehicles.clocks.sim_clock_controller import Segment

_LONGEST_WAIT_S = 60.0
"""While the clock stands only the wall's timers and the sockets can end a wait."""


class _PacedSelector(selectors.DefaultSelector):
    """The paced loop's selector: waits the wall time that the loop's time takes."""

    loop: "PacedLoop"

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Return ready descriptors; `timeout` is in the paced loop's time."""
        return super().select(self.loop.wall_wait_s(timeout))


class PacedLoop(asyncio.SelectorEventLoop):
    """An asyncio loop paced at `speed` seconds per wall second; begins at CLOCK_MONOTONIC.

    speed: more than 0, until `follow` says otherwise. Its time never goes back.
    """

    def __init__(self, speed: float = 1.0) -> None:
        now_s = time.monotonic()
        self._segment = Segment(now_s, now_s, speed)
        self._latest_s = now_s
        self._wall_timers: list[tuple[float, int, asyncio.TimerHandle]] = []
        self._wall_timers_set = 0
        waits = _PacedSelector()
        waits.loop = self
        super().__init__(waits)

    @property
    def segment(self) -> Segment:
        """Return the present segment of the paced clock."""
        return self._segment

    def time(self) -> float:
        """Return the paced loop's time in seconds."""
        now_s = self._segment.at(time.monotonic())
        self._latest_s = max(self._latest_s, now_s)
        return self._latest_s

    def follow(self, segment: Segment) -> None:
        """Continue by another segment; where it is behind, the paced clock stands meanwhile."""
        self.time()
        self._segment = segment

    def call_wall_later(self, delay_s: float, callback: Callable[[], object]) -> asyncio.Handle:
        """Call after so much wall time, whatever the loop's pace."""
        when_s = time.monotonic() + delay_s
        timer = asyncio.TimerHandle(when_s, callback, (), self)
        self._wall_timers_set += 1
        heappush(self._wall_timers, (when_s, self._wall_timers_set, timer))
        return timer

    def wall_wait_s(self, timeout_s: float | None) -> float | None:
        """Return how long the paced loop may wait; calls what is due by the wall clock."""
        timers, now_s = self._wall_timers, time.monotonic()
        while timers and (timers[0][0] <= now_s or timers[0][2].cancelled()):
            timer = heappop(timers)[2]
            if not timer.cancelled():
                self.call_soon(_run_timer, timer)
                timeout_s = 0.0
        if timeout_s is not None and timeout_s > 0.0:
            rate = self._segment.rate
            timeout_s = min(timeout_s / rate if rate > 1e-6 else _LONGEST_WAIT_S, _LONGEST_WAIT_S)
        if not timers:
            return timeout_s
        wait_s = max(0.0, timers[0][0] - now_s)
        return wait_s if timeout_s is None else min(timeout_s, wait_s)


def _run_timer(timer: asyncio.TimerHandle) -> None:
    """Run a due timer of the paced loop, unless it was cancelled."""
    if not timer.cancelled():
        timer._run()  # noqa: SLF001 - asyncio's loops do so


def call_wall_later(delay_s: float, callback: Callable[[], object]) -> asyncio.Handle:
    """Call after so much wall time, paced loop or not: for watchdogs."""
    loop = asyncio.get_running_loop()
    if isinstance(loop, PacedLoop):
        return loop.call_wall_later(delay_s, callback)
    return loop.call_later(delay_s, callback)


@asynccontextmanager
async def wall_timeout(delay_s: float | None) -> AsyncIterator[None]:
    """Raise TimeoutError as asyncio.timeout does, by the wall clock, paced loop or not."""
    loop = asyncio.get_running_loop()
    async with asyncio.timeout(None) as limit:
        if delay_s is None:
            yield
            return
        timer = call_wall_later(delay_s, lambda: limit.reschedule(loop.time()))
        try:
            yield
        finally:
            timer.cancel()
