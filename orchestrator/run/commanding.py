"""Takes an operator's commands in flight; the guard acts on them and says so."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass

from orchestrator.operator import Inbox
from orchestrator.recording.run_recorder import RunRecorder
from orchestrator.run.aboard import Aboard
from orchestrator.run.fencing import Fencing
from orchestrator.run.judging import Bench
from orchestrator.run.opening import Pair
from orchestrator.run.setup import RunSetup
from orchestrator.run.telling import Telling
from safety.guard.base import Guard
from safety.guard.operator_command import OperatorCommand

_POLL_S = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Commanding:
    """Passes on what comes in. record: told of each command."""

    inbox: Inbox
    guard: Guard
    fencing: Fencing
    record: Callable[[OperatorCommand], None]

    async def run(self, alive: Callable[[], None]) -> None:
        """Listen until cancelled. alive: called twenty times a second."""
        while True:
            alive()
            while (command := self.inbox.poll()) is not None:
                self.record(command)
                self._pass_on(command)
            await asyncio.sleep(_POLL_S)

    def _pass_on(self, command: OperatorCommand) -> None:
        if command.kind == "geofence":
            self.fencing.ask(command)
        else:
            self.guard.command(command)


def commanding_of(
    setup: RunSetup,
    pair: Pair,
    bench: Bench,
    *,
    telling: Telling,
    recorder: RunRecorder,
    inbox: Inbox,
    aboard: Aboard,
) -> Commanding:
    """Return what takes the commands of a run's operators."""

    def answer(command: OperatorCommand, ok: bool, text: str) -> None:
        recorder.note("answer", kind=command.kind, who=command.who, ok=ok, text=text)
        telling.answer(command, ok, text)

    fencing = Fencing(
        guard=pair.guard,
        aboard=aboard.fences,
        frame=setup.campaign.world.frame,
        present=dict(setup.campaign.fences.items()),
        flying=tuple(one.name for one in setup.vehicles),
        changed=bench.fences,
        answer=answer,
    )
    pair.guard.on_event(fencing.take)
    return Commanding(inbox=inbox, guard=pair.guard, fencing=fencing, record=recorder.operator)
