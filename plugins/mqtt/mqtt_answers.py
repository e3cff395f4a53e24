"""Replies to MQTT commands: one at once, and a final one after all runs have acknowledged."""

import asyncio
from collections.abc import Callable, Mapping
from typing import Protocol

from wil_campaign.orchestrator.operator.acknowledgements import (
    WITHIN_S,
    AcknowledgedRuns,
    runs_with_places_text,
)
from wil_campaign.safety.guard.core.operator_command import OperatorCommand


class PublishAnswer(Protocol):
    """Publishes an answer to a command (protocol)."""

    def __call__(self, command: OperatorCommand, *, ok: bool, text: str, final: bool) -> None:
        """Publish an answer to a command; final: no other follows."""


class CommandAnswers:
    """Answers commands; the answer is final once each run in flight has acknowledged or ended.

    acknowledged: returns the acknowledgements of the campaign's newest command. When another
    command comes first, the awaited answer becomes final at once.
    """

    def __init__(
        self, *, acknowledged: Callable[[], AcknowledgedRuns | None], answer: PublishAnswer
    ) -> None:
        self._acknowledged = acknowledged
        self._answer = answer
        self._awaited: OperatorCommand | None = None
        self._late: asyncio.TimerHandle | None = None

    def obeyed(self, command: OperatorCommand, text: str) -> None:
        """Answer a command that was executed; each run itself reports the result of a geofence."""
        if command.kind == "geofence":
            self._answer(command, ok=True, text=text, final=False)
            return
        newest = self._acknowledged()
        is_awaited = newest is not None and newest.command is command and bool(newest.waiting)
        self._answer(command, ok=True, text=text, final=not is_awaited)
        if is_awaited:
            self._awaited = command
            loop = asyncio.get_running_loop()
            self._late = loop.call_later(WITHIN_S, self._end_late)

    def refused(self, command: OperatorCommand, text: str) -> None:
        """Answer a command that was refused."""
        self._answer(command, ok=False, text=text, final=True)

    def update(self) -> None:
        """Answer the awaited command once all runs have acknowledged, or another command came."""
        newest = self._acknowledged()
        if self._awaited is None or newest is None:
            return
        if newest.command is not self._awaited:
            self._end(ok=True, text="another command came before each run had acknowledged this")
        elif not newest.waiting:
            self._end(ok=True, text=_by_text(newest.by))

    def close(self) -> None:
        """Stop waiting for acknowledgements."""
        self._awaited = None
        if self._late is not None:
            self._late.cancel()
            self._late = None

    def _end_late(self) -> None:
        newest = self._acknowledged()
        if newest is not None:
            missing = runs_with_places_text(newest.waiting)
            self._end(ok=False, text=f"not acknowledged within {WITHIN_S:g} s by {missing}")

    def _end(self, *, ok: bool, text: str) -> None:
        command = self._awaited
        self.close()
        if command is not None:
            self._answer(command, ok=ok, text=text, final=True)


def _by_text(by: Mapping[str, str]) -> str:
    return f"acknowledged by {runs_with_places_text(by)}" if by else "all runs in flight have ended"
