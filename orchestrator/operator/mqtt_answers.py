"""Answers to commands by MQTT: what was done, at once, and who has acknowledged it."""

import asyncio
from collections.abc import Callable, Mapping
from typing import Protocol

from orchestrator.operator.acknowledgements import WITHIN_S, Acknowledged, runs_text
from safety.guard.core.operator_command import OperatorCommand


class Answer(Protocol):
    """Publishes an answer to a command (protocol)."""

    def __call__(self, command: OperatorCommand, *, ok: bool, text: str, final: bool) -> None:
        """Publish an answer to a command; final: no other follows."""


class CommandAnswers:
    """Answers commands: final once each run that was in flight has acknowledged, or is over.

    acknowledged: who has acknowledged the campaign's newest command. An answer that is awaited when
    another command comes is final then.
    """

    def __init__(self, *, acknowledged: Callable[[], Acknowledged | None], answer: Answer) -> None:
        self._acknowledged = acknowledged
        self._answer = answer
        self._awaited: OperatorCommand | None = None
        self._late: asyncio.TimerHandle | None = None

    def obeyed(self, command: OperatorCommand, text: str) -> None:
        """Answer a command that was obeyed; of a fence each run says what became of it."""
        if command.kind == "geofence":
            self._answer(command, ok=True, text=text, final=False)
            return
        found = self._acknowledged()
        is_awaited = found is not None and found.command is command and bool(found.waiting)
        self._answer(command, ok=True, text=text, final=not is_awaited)
        if is_awaited:
            self._awaited = command
            loop = asyncio.get_running_loop()
            self._late = loop.call_later(WITHIN_S, self._end_without)

    def refused(self, command: OperatorCommand, text: str) -> None:
        """Answer a command that was refused."""
        self._answer(command, ok=False, text=text, final=True)

    def look(self) -> None:
        """Answer the awaited command once it is acknowledged by all, or another one came."""
        found = self._acknowledged()
        if self._awaited is None or found is None:
            return
        if found.command is not self._awaited:
            self._end(ok=True, text="another command came before each run had acknowledged this")
        elif not found.waiting:
            self._end(ok=True, text=_by_text(found.by))

    def close(self) -> None:
        """Await no acknowledgement any more."""
        self._awaited = None
        if self._late is not None:
            self._late.cancel()
            self._late = None

    def _end_without(self) -> None:
        found = self._acknowledged()
        if found is not None:
            missing = runs_text(found.waiting)
            self._end(ok=False, text=f"not acknowledged within {WITHIN_S:g} s by {missing}")

    def _end(self, *, ok: bool, text: str) -> None:
        command = self._awaited
        self.close()
        if command is not None:
            self._answer(command, ok=ok, text=text, final=True)


def _by_text(by: Mapping[str, str]) -> str:
    return f"acknowledged by {runs_text(by)}" if by else "what was in flight has ended"
