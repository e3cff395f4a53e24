"""Reports how far a process has come that follows the run clock of another."""

from collections.abc import Callable

from vehicles.clocks.lockstep import REPORT_S
from vehicles.clocks.paced_loop import PacedLoop


class ProgressReporter:
    """Reports the moment until which a paced loop has done all that was due.

    A job in a thread counts as well: until it is done the process has come as far as when the job
    began.
    """

    def __init__(self, *, loop: PacedLoop, report: Callable[[float], None]) -> None:
        self._loop = loop
        self._report = report
        self._reached_s = loop.time()
        self._next = loop.call_at(self._reached_s, self._on_due, self._reached_s)
        loop.on_job_done(self._publish)

    def stop(self) -> None:
        """Stop the reports of progress."""
        self._next.cancel()
        self._loop.on_job_done(None)

    def _on_due(self, due_s: float) -> None:
        # Timers run in the order of their times: all of before are done, or about to be.
        self._loop.call_soon(self._reach, due_s)
        next_s = max(due_s + REPORT_S, self._loop.time())
        self._next = self._loop.call_at(next_s, self._on_due, next_s)

    def _reach(self, run_s: float) -> None:
        self._reached_s = run_s
        self._publish()

    def _publish(self) -> None:
        self._report(min(self._reached_s, self._loop.oldest_job_s))
