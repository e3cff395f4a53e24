"""Which runs have acknowledged the newest command of an operator."""

from collections.abc import Mapping
from typing import Any

from orchestrator.model.flight_place import FlightPlace
from safety.guard.core.operator_command import OperatorCommand


class Acknowledgements:
    """Of the newest command: the runs that are to acknowledge it, and those that have."""

    def __init__(self) -> None:
        self._command: OperatorCommand | None = None
        self._waiting: dict[str, FlightPlace] = {}
        self._by: dict[str, FlightPlace] = {}

    def expect(self, command: OperatorCommand, runs: Mapping[str, FlightPlace]) -> None:
        """Begin with a command that was passed on to runs."""
        self._command, self._waiting, self._by = command, dict(runs), {}

    def take(self, run: str, command_id: str) -> None:
        """Take that a run has acknowledged a command; an older one's is dropped."""
        if self._command is not None and command_id == self._command.command_id:
            place = self._waiting.pop(run, None)
            if place is not None:
                self._by[run] = place

    def ended(self, run: str) -> None:
        """Take that a run is over: nobody waits for it any more."""
        self._waiting.pop(run, None)

    def plain(self) -> dict[str, Any] | None:
        """Return it as plain values for an operator; None before the first command."""
        if self._command is None:
            return None
        return {
            "command": self._command.kind,
            "who": self._command.who,
            "by": {run: str(place) for run, place in self._by.items()},
            "waiting": {run: str(place) for run, place in self._waiting.items()},
        }
