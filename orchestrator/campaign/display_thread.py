"""A thread that displays progress: a terminal that takes no output delays no operator command."""

import threading
from collections.abc import Callable
from queue import SimpleQueue
from typing import Protocol, Self

from wil_campaign.foundation.tasks import FAULTS
from wil_campaign.orchestrator.operator.run_messages import RunProgressReport
from wil_campaign.orchestrator.run_results.run_result import RunResult

_MOST_UPDATES, _MOST_LINES = 1_000, 100_000
"""How many calls wait for a terminal before further progress, and further lines, are left out."""
_SETTLED_S = 2.0


class ProgressDisplay(Protocol):
    """Displays the progress of runs in flight and finished ones; a context manager."""

    def __enter__(self) -> Self:
        """Start the progress display."""

    def __exit__(self, *_: object) -> None:
        """End the progress display and restore the terminal."""

    def progress(self, progress: RunProgressReport) -> None:
        """Display the progress of a run in flight."""

    def finished(self, result: RunResult) -> None:
        """Display a run's verdict."""

    def say(self, text: str) -> None:
        """Display a message."""

    def settle(self) -> None:
        """Wait until all is displayed, but not for a terminal that takes nothing."""


class DisplayThread:
    """A progress display that calls another one in a thread, in order: its caller never waits.

    A terminal may take nothing for hours (Ctrl-S, an ssh connection that stands still), and so may
    a pipe. An exception of the other display is raised by a later call, or by the exit where none
    was raised before. The exit waits until all is displayed.
    """

    def __init__(self, display: ProgressDisplay) -> None:
        self._display = display
        self._calls: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._errors: SimpleQueue[BaseException] = SimpleQueue()
        self._left_out = 0
        self._has_raised = False
        self._thread = threading.Thread(target=self._call_display, name="display", daemon=True)

    def __enter__(self) -> Self:
        self._display.__enter__()
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._calls.put(None)
        self._thread.join()
        self._display.__exit__(*error)
        if not self._has_raised and not any(error):
            self._raise_error()

    def progress(self, progress: RunProgressReport) -> None:
        """Have the progress of a run displayed, unless too much waits."""
        if self._calls.qsize() < _MOST_UPDATES:
            self._calls.put(lambda: self._display.progress(progress))
        self._raise_error()

    def finished(self, result: RunResult) -> None:
        """Have a run's verdict displayed."""
        self._put_line(lambda: self._display.finished(result))

    def say(self, text: str) -> None:
        """Have a message displayed."""
        self._put_line(lambda: self._display.say(text))

    def settle(self) -> None:
        """Wait until all is displayed, 2 s at most."""
        is_displayed = threading.Event()
        self._calls.put(is_displayed.set)
        is_displayed.wait(_SETTLED_S)
        self._raise_error()

    def _put_line(self, call: Callable[[], None]) -> None:
        if self._calls.qsize() >= _MOST_LINES:
            self._left_out += 1
        else:
            if self._left_out:
                text = f"{self._left_out} lines are left out here: too many waited for the terminal"
                self._calls.put(lambda: self._display.say(text))
                self._left_out = 0
            self._calls.put(call)
        self._raise_error()

    def _raise_error(self) -> None:
        """Raise the oldest exception of the display that is not raised yet."""
        if not self._errors.empty():
            self._has_raised = True
            raise self._errors.get()

    def _call_display(self) -> None:
        while (call := self._calls.get()) is not None:
            try:
                call()
            except FAULTS as error:
                self._errors.put(error)
