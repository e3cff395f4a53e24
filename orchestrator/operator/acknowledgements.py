"""Which runs have acknowledged the newest command of an operator."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from wil_campaign.orchestrator.operator.run_messages import FlightPlace
from wil_campaign.safety.guard.core.operator_command import OperatorCommand

WITHIN_S = 5.0
"""Runs in flight that have not acknowledged a command after this time are reported by name."""


@dataclass(frozen=True, slots=True)
class AcknowledgedRuns:
    """Runs that have acknowledged a command, and runs that have not yet, each with its place."""

    command: OperatorCommand
    by: Mapping[str, str]
    waiting: Mapping[str, str]

    def plain(self) -> dict[str, Any]:
        """Return the acknowledgements as plain values for an operator."""
        return {
            "command": self.command.kind,
            "who": self.command.who,
            "by": dict(self.by),
            "waiting": dict(self.waiting),
        }


class Acknowledgements:
    """Tracks which runs have acknowledged the newest operator command."""

    def __init__(self) -> None:
        self._command: OperatorCommand | None = None
        self._waiting: dict[str, FlightPlace] = {}
        self._by: dict[str, FlightPlace] = {}

    def expect(self, command: OperatorCommand, runs: Mapping[str, FlightPlace]) -> None:
        """Track a new command, which was passed on to these runs."""
        self._command, self._waiting, self._by = command, dict(runs), {}

    def acknowledge(self, run: str, command_id: str) -> None:
        """Record that a run has acknowledged a command; an older command is ignored."""
        if self._command is not None and command_id == self._command.command_id:
            place = self._waiting.pop(run, None)
            if place is not None:
                self._by[run] = place

    def ended(self, run: str) -> None:
        """Record that a run is over: its acknowledgement is not awaited any more."""
        self._waiting.pop(run, None)

    @property
    def newest(self) -> AcknowledgedRuns | None:
        """Return the acknowledgements of the newest command; None before the first."""
        if self._command is None:
            return None
        return AcknowledgedRuns(self._command, _place_texts(self._by), _place_texts(self._waiting))


def runs_with_places_text(places: Mapping[str, str]) -> str:
    """Return the names of runs with their places, for a message."""
    return ", ".join(f"{run} on {place}" if place else run for run, place in places.items())


def _place_texts(places: Mapping[str, FlightPlace]) -> dict[str, str]:
    return {run: str(place) for run, place in places.items()}
