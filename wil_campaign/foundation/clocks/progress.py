"""Reports a process's progress on the run clock."""

import math
from collections.abc import Callable

from wil_campaign.foundation.clocks.lockstep import REPORT_S
from wil_campaign.foundation.clocks.paced_loop import PacedLoop


class ClockProgressReporter:
    """Reports the moment until which a paced loop has done all that was due.

    It reports at least every `REPORT_S` of the loop's time, and once when its clock stops.
    """

    def __init__(self, *, loop: PacedLoop, report: Callable[[float], None]) -> None:
        self._loop = loop
        self._report = report
        # The first report is immediate: a clock that ran by itself until now may be ahead, and is
        # stopped until the leader's catches up.
        self._reached_s = -math.inf
        self._wake = loop.call_at(loop.time() + REPORT_S, self._on_wake)
        loop.on_idle(self._on_idle)

    def stop(self) -> None:
        """Stop the reports of progress."""
        self._wake.cancel()
        self._loop.on_idle(None)

    def _on_wake(self) -> None:
        """Wake the loop so that it reports, even when nothing else is due."""
        self._wake = self._loop.call_at(self._loop.time() + REPORT_S, self._on_wake)

    def _on_idle(self, run_s: float) -> bool:
        grown_s = run_s - self._reached_s
        has_stopped = run_s >= self._loop.segment.end_s - 1e-6
        if grown_s < (1e-6 if has_stopped else REPORT_S / 2.0):
            return False
        self._reached_s = run_s
        self._report(run_s)
        return True
