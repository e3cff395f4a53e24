"""Which runs have acknowledged the newest command of an operator."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from orchestrator.model.flight_place import FlightPlace
from safety.guard.core.operator_command import OperatorCommand

WITHIN_S = 5.0
"""What is in flight and has not acknowledged a command for so long is named."""


@dataclass(frozen=True, slots=True)
class Acknowledged:
    """Who has acknowledged a command, and who has not yet: runs, each with where it flies."""

    command: OperatorCommand
    by: Mapping[str, str]
    waiting: Mapping[str, str]

    def plain(self) -> dict[str, Any]:
        """Return it as plain values for an operator."""
        return {
            "command": self.command.kind,
            "who": self.command.who,
            "by": dict(self.by),
            "waiting": dict(self.waiting),
        }


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

    @property
    def newest(self) -> Acknowledged | None:
        """Return who has acknowledged the newest command; None before the first."""
        if self._command is None:
            return None
        return Acknowledged(self._command, _in_words(self._by), _in_words(self._waiting))


def runs_text(places: Mapping[str, str]) -> str:
    """Return runs in words, with where they fly."""
    return ", ".join(f"{run} on {place}" if place else run for run, place in places.items())


def _in_words(places: Mapping[str, FlightPlace]) -> dict[str, str]:
    return {run: str(place) for run, place in places.items()}
