"""The orchestrator's side of a clock that the guard's process leads."""

import asyncio
import time
from collections.abc import Callable

from wil_campaign.foundation.clocks.paced_loop import PacedLoop
from wil_campaign.foundation.clocks.progress import ClockProgressReporter
from wil_campaign.foundation.clocks.sim_clock_controller import ClockSegment
from wil_campaign.safety.guard.process.messages import ClockPace

_LONGEST_SILENCE_S = 0.5
"""Of wall time: without a further segment from the guard for so long the run clock hangs."""


class RemoteClock:
    """Makes the paced loop follow the remote guard's clock.

    report: called with how far the loop has come, where the guard's clock waits for it.
    """

    def __init__(self, *, report: Callable[[float], None]) -> None:
        self._report = report
        self._progress: ClockProgressReporter | None = None
        self._led = False

    def take(self, pace: ClockPace) -> None:
        """Follow a segment of the guard's clock; after it the clock continues without a leap."""
        self._led = True
        loop = asyncio.get_running_loop()
        if not isinstance(loop, PacedLoop):
            return
        holds_s = _LONGEST_SILENCE_S if pace.holds_s is None else pace.holds_s
        loop.follow(ClockSegment(pace.wall_s, pace.run_s, pace.rate, holds_s))
        if pace.holds_s is not None and self._progress is None:
            self._progress = ClockProgressReporter(loop=loop, report=self._report)

    def close(self) -> None:
        """Stop the reports of progress."""
        if self._progress is not None:
            self._progress.stop()

    def continue_alone(self) -> None:
        """Continue the remote clock without a guard at its pace, real time at least."""
        loop = asyncio.get_running_loop()
        if self._led and isinstance(loop, PacedLoop):
            self.close()
            loop.follow(ClockSegment(time.monotonic(), loop.time(), max(1.0, loop.segment.rate)))
