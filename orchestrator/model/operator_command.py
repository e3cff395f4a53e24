"""The inbox of a run for its operator's commands."""

from typing import Protocol

from wil_campaign.safety.guard.core.operator_command import OperatorCommand


class Inbox(Protocol):
    """The inbox of operator commands (protocol): polled by a run, never blocking."""

    def poll(self) -> OperatorCommand | None:
        """Return the next operator command, or None."""
