"""Errors beside the autonomy's calls: in its threads, tasks, callbacks, and as it is freed.

Python prints such an error and goes on: an autonomy half of which is dead would pass.
"""

import sys
import threading
from collections import deque
from typing import Any, Self

from wil_campaign.orchestrator.run.perception.autonomy_calls import (
    AutonomyFault,
    fault_beside_calls,
    first_own_file,
)
from wil_campaign.orchestrator.state.run_state import RunState


def decide_stray(run_state: RunState, subject: str, error: BaseException, where: str) -> None:
    """Decide a run by an error beside the calls of users' code.

    FAIL by the autonomy's code, ERROR by a recipe step's beside it, and by ours.
    """
    fault = fault_beside_calls(error, run_state.autonomy_folders)
    if fault is None:
        run_state.fault(error, where)
    elif first_own_file(error) in run_state.step_files:
        text = f"a step of the recipe {fault}"
        run_state.decide("ERROR", text, source="mixing", trace=fault.trace)
    else:
        decide_fault(run_state, subject, fault)


def decide_fault(run_state: RunState, vehicle: str, fault: AutonomyFault) -> None:
    """Decide a run by a fault of a vehicle's autonomy: from its goal on it is a FAIL.

    A process that ended is told once: its end and the next call both find it.
    """
    kind = "FAIL" if run_state.reached("goal") else fault.kind
    reason, source = f"the autonomy of {vehicle} {fault}", f"autonomy/{vehicle}"
    known = ((decisive_event.text, decisive_event.source) for decisive_event in run_state.decisive)
    if fault.trace or (reason, source) not in known:
        run_state.decide(kind, reason, source=source, trace=fault.trace)


class StrayErrors:
    """Takes the errors that Python would only print; a context manager of the main thread.

    subject: the vehicle whose autonomy is under test.
    """

    def __init__(self, run_state: RunState, subject: str) -> None:
        self._run_state = run_state
        self._subject = subject
        self._raised: deque[tuple[BaseException, str]] = deque()

    def __enter__(self) -> Self:
        self._before = threading.excepthook, sys.unraisablehook
        threading.excepthook = self._on_thread_error
        sys.unraisablehook = self._on_unraisable
        return self

    def __exit__(self, *raised: object) -> None:
        threading.excepthook, sys.unraisablehook = self._before
        self.decide()

    def decide(self) -> None:
        """Decide the run by what was raised since the last call."""
        while self._raised:
            decide_stray(self._run_state, self._subject, *self._raised.popleft())

    def _on_thread_error(self, raised: Any) -> None:
        """Keep the error of a thread for the main one. SystemExit ends a thread as asked."""
        self._before[0](raised)
        if raised.exc_value is not None and raised.exc_type is not SystemExit:
            name = "a thread" if raised.thread is None else f"thread {raised.thread.name}"
            self._raised.append((raised.exc_value, name))

    def _on_unraisable(self, raised: Any) -> None:
        """Keep an error without a caller, as of a `__del__`; those of packages are Python's."""
        self._before[1](raised)
        error, folders = raised.exc_value, self._run_state.autonomy_folders
        if error is not None and fault_beside_calls(error, folders) is not None:
            self._raised.append((error, "an object that is freed"))
