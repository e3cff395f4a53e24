"""The orchestrator's side of a clock that the guard's process leads."""

import asyncio
import math
import time
from collections.abc import Callable

from safety.guard.process.messages import Pace
from vehicles.clocks.paced_loop import PacedLoop
from vehicles.clocks.sim_clock_controller import Segment

_WITHOUT_A_WORD_S = 0.5
"""By the wall's clock: a guard that lays no further piece of the run clock has it stand."""


class RemoteClock:
    """Makes the paced loop, and listeners, follow the remote guard's clock."""

    def __init__(self) -> None:
        self._listeners: list[Callable[[Segment], None]] = []
        self._led = False

    def on_pace(self, listener: Callable[[Segment], None]) -> None:
        """Register a listener for every segment of the remote clock."""
        self._listeners.append(listener)

    def take(self, pace: Pace) -> None:
        """Follow a segment of the guard's clock; after it the clock goes on without a leap."""
        self._led = True
        self._go_on(pace, _WITHOUT_A_WORD_S)

    def go_on_alone(self) -> None:
        """Continue the remote clock without a guard at its pace, real time at least."""
        loop = asyncio.get_running_loop()
        if self._led and isinstance(loop, PacedLoop):
            rate = max(1.0, loop.segment.rate)
            self._go_on(Pace(time.monotonic(), loop.time(), rate), math.inf)

    def _go_on(self, pace: Pace, holds_s: float) -> None:
        loop = asyncio.get_running_loop()
        if isinstance(loop, PacedLoop):
            loop.follow(Segment(pace.wall_s, pace.run_s, pace.rate, holds_s))
        for listener in self._listeners:
            listener(Segment(pace.wall_s, pace.run_s, pace.rate))
