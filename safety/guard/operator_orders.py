"""What the operator's socket may ask of a guard, and how it answers."""

import asyncio
from collections.abc import Callable
from typing import Any

from safety.guard.operator_lines import OperatorLine, RefusedLineError
from safety.guard.shell import GuardShell


class OperatorOrders:
    """Obeys lines of the operator's socket. run: what people call the run.

    refused: told what was not done and why. lost: whether the orchestrator is gone.
    """

    def __init__(
        self,
        *,
        shell: GuardShell,
        run: str,
        refused: Callable[[str], None],
        lost: Callable[[], bool],
    ) -> None:
        self._shell = shell
        self._run = run
        self._refused = refused
        self._lost = lost

    def obey(self, line: OperatorLine) -> str:
        """Do what a line says. Raises RefusedLineError."""
        try:
            return self._do(line)
        except RefusedLineError as error:
            self._refused(f"{line.who}: {error}")
            raise

    def _do(self, line: OperatorLine) -> str:
        core, who = self._shell.core, line.who
        if line.command == "abort":
            self._shell.abort(who)
            return "all are brought down"
        if line.command == "geofence":
            raise RefusedLineError("geofence: send it to the campaign, not to the guard")
        if core.latched is not None:
            raise RefusedLineError(f"{line.command}: all are landing already ({core.latched})")
        if line.command == "hold":
            if core.paused:
                raise RefusedLineError("hold: all hold already")
            self._shell.hold(who)
            return "all hold"
        if not core.paused:
            raise RefusedLineError("resume: nothing is held")
        self._shell.resume(who)
        return "all go on"

    def status(self) -> dict[str, Any]:
        """Return where all stand, for the operator."""
        core = self._shell.core
        return {
            "run": self._run,
            "t_s": round(asyncio.get_running_loop().time(), 3),
            "latched": core.latched,
            "held": core.paused,
            "all_down": core.all_down,
            "orchestrator": "lost" if self._lost() else "there",
            "vehicles": {name: phase.value for name, phase in core.phases.items()},
        }
