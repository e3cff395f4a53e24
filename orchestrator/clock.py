"""The run clock: an event loop in virtual time, and the one way to run a coroutine on either.

Under virtual time `loop.time()` jumps exactly to the next timer when nothing is ready, holds
while an executor job runs, delivers the results of several jobs in the order of their
submission, and raises on deadlock. So a run's course depends on its inputs alone.
"""

import asyncio
import selectors
from collections import deque
from collections.abc import Callable, Coroutine
from concurrent.futures import Executor
from typing import Any, Literal, TypeVar, TypeVarTuple

T = TypeVar("T")
Ts = TypeVarTuple("Ts")
Clock = Literal["virtual", "wall"]

_POLLS_BETWEEN_FD_CHECKS = 64
"""A ready callback does not need the file descriptors: they are looked at now and then only."""


class VirtualDeadlockError(RuntimeError):
    """Nothing is ready, no timer is set and no job runs: every task waits for ever."""


class _JumpingSelector(selectors.DefaultSelector):
    """Instead of waiting for time to pass, has the loop's time jump to the next timer."""

    def __init__(self) -> None:
        super().__init__()
        self.loop: VirtualLoop | None = None
        self._polls = 0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Return ready descriptors: real waiting happens only for an executor job."""
        loop = self.loop
        if loop is None:
            return super().select(timeout)
        if timeout is not None and timeout <= 0:
            self._polls += 1
            return [] if self._polls % _POLLS_BETWEEN_FD_CHECKS else super().select(0)
        if loop.jobs_running:
            return super().select(None)
        ready = super().select(0)
        if not ready:
            loop.jump()
        return ready


class VirtualLoop(asyncio.SelectorEventLoop):
    """An asyncio loop whose time starts at 0 and costs nothing to pass."""

    def __init__(self) -> None:
        self._now_s = 0.0
        self._jobs: deque[asyncio.Future[Any]] = deque()
        self.jobs_running = 0
        selector = _JumpingSelector()
        super().__init__(selector)
        selector.loop = self
        self._clock_resolution = 1e-9

    def time(self) -> float:
        """Return the virtual time in seconds."""
        return self._now_s

    def jump(self) -> None:
        """Set the time to the next timer's, exactly; raise when there is none."""
        scheduled: list[asyncio.TimerHandle] = vars(self)["_scheduled"]
        if not scheduled:
            raise VirtualDeadlockError("virtual time stands still: no timer, no job, nothing ready")
        self._now_s = max(self._now_s, scheduled[0].when())

    def run_in_executor(
        self, executor: Executor | None, func: Callable[[*Ts], T], *args: *Ts
    ) -> asyncio.Future[T]:
        """Run a job in a thread; the clock holds, and results come in the order of submission."""
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
        """End the threads of the default executor, with the clock held.

        Takes `timeout` from Python 3.12 on, as the base class does.
        """
        self.jobs_running += 1
        try:
            await super().shutdown_default_executor(*timeout)
        finally:
            self.jobs_running -= 1


def _copy_outcome(source: asyncio.Future[T], target: asyncio.Future[T]) -> None:
    if target.done():
        source.exception() if not source.cancelled() else None
    elif source.cancelled():
        target.cancel()
    elif (error := source.exception()) is not None:
        target.set_exception(error)
    else:
        target.set_result(source.result())


def run_virtual(main: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine to its end in virtual time and return its result."""
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(main)


def run_on(clock: Clock, main: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine to its end on the run clock that was asked for."""
    return run_virtual(main) if clock == "virtual" else asyncio.run(main)
