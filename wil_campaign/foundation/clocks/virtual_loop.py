"""The run clock: an event loop in virtual time, and how a coroutine is run on each clock.

Under virtual time `loop.time()` jumps exactly to the next timer when nothing is ready, and holds
while an executor job runs. The results of several jobs are delivered in the order of their
submission, and a deadlock raises. So a run depends on its inputs alone.
"""

import asyncio
import selectors
from collections import deque
from collections.abc import Callable, Coroutine
from concurrent.futures import Executor
from contextvars import Context
from heapq import heappop, heappush
from typing import Any, Literal, TypeVar, TypeVarTuple

from wil_campaign.foundation.clocks.paced_loop import PacedLoop

T = TypeVar("T")
Ts = TypeVarTuple("Ts")
Clock = Literal["virtual", "wall", "scaled"]

_TURNS_BETWEEN_POLLS = 64
"""External events do not advance virtual time: file descriptors are polled only now and then."""
_SAME_INSTANT_S = 1e-9
"""Timers this close are one instant: two computations of `t0 + k / hz` differ by rounding."""


class VirtualDeadlockError(RuntimeError):
    """The virtual clock's deadlock: nothing is ready, no timer is set and no job runs."""


class VirtualLoop(asyncio.SelectorEventLoop):
    """An asyncio loop on a virtual clock that starts at 0 and never waits for a timer.

    Timers of one instant run in the order in which they were set. It overrides asyncio's timers and
    turns: a second of flight has hundreds of turns, and asyncio's cost as much as the physics.
    """

    def __init__(self) -> None:
        self._now_s = 0.0
        self._jobs: deque[asyncio.Future[Any]] = deque()
        self.jobs_running = 0
        self._timers: list[tuple[float, int, asyncio.TimerHandle]] = []
        self._timers_set = 0
        self._turns = 0
        self._descriptors = selectors.DefaultSelector()
        super().__init__(self._descriptors)
        self._callbacks: deque[asyncio.Handle] = vars(self)["_ready"]

    def time(self) -> float:
        """Return the virtual clock's time in seconds."""
        return self._now_s

    def call_at(
        self,
        when: float,
        callback: Callable[[*Ts], object],
        *args: *Ts,
        context: Context | None = None,
    ) -> asyncio.TimerHandle:
        """Call `callback` at a time of the virtual clock; at once when that is past."""
        timer = asyncio.TimerHandle(when, callback, args, self, context)
        self._timers_set += 1
        heappush(self._timers, (when, self._timers_set, timer))
        return timer

    def close(self) -> None:
        """Close the virtual clock's loop; its timers are dropped."""
        self._timers.clear()
        super().close()

    def _timer_handle_cancelled(self, handle: asyncio.TimerHandle) -> None:
        """Note a cancelled timer of the virtual clock: dropped when due."""

    def _run_once(self) -> None:
        """Make one turn of asyncio's `run_forever` on the virtual clock."""
        callbacks, timers = self._callbacks, self._timers
        self._turns += 1
        if self._turns % _TURNS_BETWEEN_POLLS == 0:
            self._look_outside(0.0)
        if not callbacks:
            self._wait()
        end_s = self._now_s
        instant_s = end_s + _SAME_INSTANT_S
        while timers and timers[0][0] <= instant_s:
            end_s, _, timer = heappop(timers)
            callbacks.append(timer)
        for _ in range(len(callbacks)):
            handle = callbacks.popleft()
            if not handle._cancelled:  # noqa: SLF001 - asyncio's loops do so
                handle._run()  # noqa: SLF001 - asyncio's loops do so
        # Code that waits repeatedly for a time that is a rounding ahead must reach it.
        self._now_s = max(self._now_s, end_s)

    def _wait(self) -> None:
        """Wait for a job, or else advance the virtual clock exactly to the next timer."""
        if self.jobs_running:
            self._look_outside(None)
            return
        timers = self._timers
        while timers and timers[0][2]._cancelled:  # noqa: SLF001 - asyncio's loops do so
            heappop(timers)
        if timers:
            self._now_s = max(self._now_s, timers[0][0])
            return
        self._look_outside(0.0)
        if not self._callbacks and not vars(self)["_stopping"]:
            raise VirtualDeadlockError(
                "virtual time cannot advance: no timer is set, no job runs and no callback is ready"
            )

    def _look_outside(self, timeout_s: float | None) -> None:
        """Take ready file descriptors into the virtual loop; None waits for one."""
        ready = self._descriptors.select(timeout_s)
        self._process_events(ready)  # type: ignore[attr-defined]  # typeshed leaves it out

    def run_in_executor(
        self, executor: Executor | None, func: Callable[[*Ts], T], *args: *Ts
    ) -> asyncio.Future[T]:
        """Run a job in a thread while the virtual clock holds; results keep their order."""
        raw = super().run_in_executor(executor, func, *args)
        result: asyncio.Future[T] = self.create_future()
        self.jobs_running += 1
        predecessor = self._jobs[-1] if self._jobs else None
        self._jobs.append(result)

        def deliver(_: object = None) -> None:
            if not raw.done() or (predecessor is not None and not predecessor.done()):
                return
            if result not in self._jobs:
                return
            self._jobs.remove(result)
            self.jobs_running -= 1
            _copy_outcome(raw, result)

        raw.add_done_callback(deliver)
        if predecessor is not None:
            predecessor.add_done_callback(deliver)
        return result

    async def shutdown_default_executor(self, *timeout: float | None) -> None:
        """End the executor's threads while the virtual clock holds.

        Takes `timeout` from Python 3.12 on, as the base class does.
        """
        self.jobs_running += 1
        try:
            await super().shutdown_default_executor(*timeout)
        finally:
            self.jobs_running -= 1


def _copy_outcome(source: asyncio.Future[T], target: asyncio.Future[T]) -> None:
    """Copy a thread job's outcome to the virtual loop's future."""
    if target.done():
        source.exception() if not source.cancelled() else None
    elif source.cancelled():
        target.cancel()
    elif (error := source.exception()) is not None:
        target.set_exception(error)
    else:
        target.set_result(source.result())


def run_virtual(main: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine to its end on the virtual clock and return its result."""
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(main)


def run_on_clock(clock: Clock, main: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine to its end on the requested clock: wall, scaled or virtual.

    scaled: it equals the wall clock until a guard controls it.
    """
    if clock == "virtual":
        return run_virtual(main)
    with asyncio.Runner(loop_factory=PacedLoop if clock == "scaled" else None) as runner:
        return runner.run(main)
