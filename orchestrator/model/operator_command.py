"""Where a run looks for its operator's commands."""

from typing import Protocol

from safety.guard.core.operator_command import OperatorCommand


class Inbox(Protocol):
    """Where a run looks for commands, often and without waiting."""

    def poll(self) -> OperatorCommand | None:
        """Return the next command that has come, or None."""
