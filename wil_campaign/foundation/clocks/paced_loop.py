"""An asyncio loop whose clock, and with it every timer, runs faster or slower than wall time."""

import asyncio
import selectors
import socket
import time
from collections.abc import AsyncIterator, Callable
from concurrent.futures import Executor
from contextlib import asynccontextmanager
from heapq import heappop, heappush
from typing import TypeVar, TypeVarTuple

from wil_campaign.foundation.clocks.sim_clock_controller import ClockSegment

T = TypeVar("T")
Ts = TypeVarTuple("Ts")

_LONGEST_WAIT_S = 60.0
"""While the clock is stopped only wall timers and sockets can end a wait."""
_SAME_INSTANT_S = 1e-9
"""The tolerance within which asyncio takes a timer to be due."""
_MOST_TURNS_TO_IDLE = 64
"""Turns with incoming data until idle is reported anyway: a flooded process must not stop the
clock for good."""


class _PacedSelector(selectors.DefaultSelector):
    """The paced loop's selector: waits the wall time that the loop's time takes."""

    loop: "PacedLoop"
    first: int | None = None
    _turns = 0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Return ready descriptors, the first one first; `timeout` is in the paced loop's time."""
        wait_s = self.loop.wall_wait_s(timeout)
        ready: list[tuple[selectors.SelectorKey, int]] = []
        if self.loop.watches_idle and wait_s != 0.0:
            ready = super().select(0.0)
            self._turns += 1
            if not ready or self._turns > _MOST_TURNS_TO_IDLE:
                self._turns = 0
                if self.loop.become_idle():
                    wait_s = 0.0
        if not ready:
            ready = super().select(wait_s)
        if self.first is not None and len(ready) > 1:
            ready.sort(key=self._is_other)
        return ready

    def _is_other(self, event: tuple[selectors.SelectorKey, int]) -> bool:
        return event[0].fd != self.first


class PacedLoop(asyncio.SelectorEventLoop):
    """An asyncio loop paced at `speed` seconds per wall second; begins at CLOCK_MONOTONIC.

    speed: more than 0, until `follow` says otherwise. Its time never goes back.
    """

    def __init__(self, speed: float = 1.0) -> None:
        now_s = time.monotonic()
        self._segment = ClockSegment(now_s, now_s, speed)
        self._latest_s = now_s
        self._wall_timers: list[tuple[float, int, asyncio.TimerHandle]] = []
        self._wall_timers_set = 0
        self._jobs: dict[object, float] = {}
        self._idle: Callable[[float], bool] | None = None
        self._waits = _PacedSelector()
        self._waits.loop = self
        super().__init__(self._waits)

    @property
    def segment(self) -> ClockSegment:
        """Return the present segment of the paced clock."""
        return self._segment

    def time(self) -> float:
        """Return the paced loop's time in seconds."""
        now_s = self._segment.at(time.monotonic())
        self._latest_s = max(self._latest_s, now_s)
        return self._latest_s

    def follow(self, segment: ClockSegment) -> None:
        """Continue by another segment; until a segment behind catches up, the clock is stopped."""
        self.time()
        self._segment = segment

    def on_idle(self, callback: Callable[[float], bool] | None) -> None:
        """Call `callback` when all due callbacks have run and all incoming data is read.

        It gets the loop time until which that holds, and returns whether it did something. A job
        that still runs in a thread was due when it began.
        """
        self._idle = callback

    @property
    def watches_idle(self) -> bool:
        """Return whether it matters when the paced loop has nothing to do."""
        return self._idle is not None

    def become_idle(self) -> bool:
        """Report that nothing is due now; return whether the callback may have changed that."""
        run_s = min(self._latest_s, *self._jobs.values()) if self._jobs else self._latest_s
        return self._idle is not None and self._idle(run_s)

    def add_first_reader(self, end: socket.socket, callback: Callable[[], object]) -> None:
        """Read from a socket before all others that are ready at the same time."""
        self._waits.first = end.fileno()
        self.add_reader(end, callback)

    def run_in_executor(
        self, executor: Executor | None, func: Callable[[*Ts], T], *args: *Ts
    ) -> asyncio.Future[T]:
        """Run a job in a thread, and keep account of its start."""
        future = super().run_in_executor(executor, func, *args)
        job = object()
        self._jobs[job] = self.time()
        future.add_done_callback(lambda _: self._jobs.pop(job))
        return future

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
            timeout_s = self._wall_s_until(self._latest_s + timeout_s)
        if not timers:
            return timeout_s
        wait_s = max(0.0, timers[0][0] - now_s)
        return wait_s if timeout_s is None else min(timeout_s, wait_s)

    def _wall_s_until(self, run_s: float) -> float:
        """Return the wall time until a moment of the loop's time."""
        segment = self._segment
        if segment.rate <= 1e-6 or run_s > segment.end_s + _SAME_INSTANT_S:
            return _LONGEST_WAIT_S
        return min(max(run_s - self._latest_s, 0.0) / segment.rate, _LONGEST_WAIT_S)


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
