"""Where a run looks for its operator's commands."""

from collections import deque
from collections.abc import Callable
from typing import Protocol

from safety.guard.core.operator_command import OperatorCommand


class Inbox(Protocol):
    """Where a run looks for commands, often and without waiting."""

    def poll(self) -> OperatorCommand | None:
        """Return the next command that has come, or None."""


class ScriptedInbox:
    """Commands that come at given times of the run clock: for tests and for virtual time."""

    def __init__(
        self, *, time: Callable[[], float], script: tuple[tuple[float, OperatorCommand], ...] = ()
    ) -> None:
        self._time = time
        self._script = deque(sorted(script, key=lambda item: item[0]))

    def poll(self) -> OperatorCommand | None:
        """Return the next command whose time has come, or None."""
        if self._script and self._script[0][0] <= self._time():
            return self._script.popleft()[1]
        return None
