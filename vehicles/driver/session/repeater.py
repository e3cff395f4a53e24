"""Repeats an action at a fixed rate on the run clock, without a task."""

import asyncio
from collections.abc import Callable


class Repeater:
    """Repeats `action` at t0 + k * period_s on the loop's clock.

    Ticks that were missed (a stalled process) are skipped, not made up for.
    """

    def __init__(self, *, period_s: float, action: Callable[[], None]) -> None:
        self._period_s = period_s
        self._action = action
        self._timer: asyncio.TimerHandle | None = None
        self._first_s = 0.0
        self._count = 0

    @property
    def running(self) -> bool:
        """Return whether the repeater was started and not stopped."""
        return self._timer is not None

    def start(self, *, at_once: bool = True) -> None:
        """Start repeating now; does nothing when it runs already.

        at_once: whether the action is also executed now, or first after a period.
        """
        if self._timer is not None:
            return
        loop = asyncio.get_running_loop()
        self._first_s = loop.time()
        self._count = 0 if at_once else 1
        if at_once:
            self._tick()
        else:
            self._timer = loop.call_at(self._first_s + self._period_s, self._tick)

    def stop(self) -> None:
        """Stop repeating; may be called more than once."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _tick(self) -> None:
        loop = asyncio.get_running_loop()
        missed = int((loop.time() - self._first_s) / self._period_s)
        self._count = max(self._count + 1, missed + 1 if missed > self._count else 0)
        self._timer = loop.call_at(self._first_s + self._count * self._period_s, self._tick)
        self._action()
