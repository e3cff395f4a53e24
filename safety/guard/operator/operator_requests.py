"""Executes the requests of the operator's socket on a guard, and returns its status."""

import asyncio
from collections.abc import Callable
from typing import Any

from wil_campaign.safety.guard.core.commands import OperatorAction
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.guard.local_guard import LocalGuard
from wil_campaign.safety.guard.operator.operator_lines import RefusedLineError


class OperatorOrders:
    """Executes requests of the operator's socket. run: the run's name in messages.

    refused: called with each refused request and the reason. lost: returns whether the orchestrator
    is gone.
    """

    def __init__(
        self,
        *,
        guard: LocalGuard,
        run: str,
        refused: Callable[[str], None],
        lost: Callable[[], bool],
    ) -> None:
        self._guard = guard
        self._run = run
        self._refused = refused
        self._is_orchestrator_lost = lost

    def obey(self, command: OperatorCommand) -> str:
        """Execute an operator's request. Raises RefusedLineError."""
        try:
            return self._execute(command)
        except RefusedLineError as error:
            self._refused(f"{command.who}: {error}")
            raise

    def _execute(self, command: OperatorCommand) -> str:
        core = self._guard.core
        if command.kind == "abort":
            self._guard.send(OperatorAction(command))
            return "all vehicles are being landed"
        if command.kind == "geofence":
            raise RefusedLineError("geofence: send this command to the campaign, not to the guard")
        if core.latched is not None:
            raise RefusedLineError(
                f"{command.kind}: all vehicles are landing already ({core.latched})"
            )
        if command.kind == "hold":
            if core.paused:
                raise RefusedLineError("hold: all vehicles hold already")
            self._guard.send(OperatorAction(command))
            return "all vehicles hold"
        if not core.paused:
            raise RefusedLineError("resume: no vehicle holds")
        self._guard.send(OperatorAction(command))
        return "all vehicles resume"

    def status(self) -> dict[str, Any]:
        """Return the status of all vehicles for the operator's request."""
        core = self._guard.core
        return {
            "run": self._run,
            "t_s": round(asyncio.get_running_loop().time(), 3),
            "latched": core.latched,
            "held": core.paused,
            "all_down": core.all_down,
            "orchestrator": "lost" if self._is_orchestrator_lost() else "there",
            "vehicles": {name: phase.value for name, phase in core.phases.items()},
        }
