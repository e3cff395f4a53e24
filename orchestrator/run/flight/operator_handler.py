"""Passes an operator's commands to the guard in flight, and fence changes to their handler."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass

from wil_campaign.orchestrator.operator.run_messages import OperatorInbox
from wil_campaign.orchestrator.recording.run_recorder import RunRecorder
from wil_campaign.orchestrator.run.flight.fence_changes import FenceChanges
from wil_campaign.orchestrator.run.flight.progress_reporter import RunProgressReporter
from wil_campaign.orchestrator.run.judging.oracle_runner import OracleRunner
from wil_campaign.orchestrator.run.vehicles.onboard_fences import OnboardFences
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.safety.guard.core.commands import OperatorAction
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.guard.guard import Guard

_POLL_S = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class OperatorHandler:
    """Handles a run's operator commands. record, acknowledge: called with each command."""

    inbox: OperatorInbox
    guard: Guard
    fence_changes: FenceChanges
    record: Callable[[OperatorCommand], None]
    acknowledge: Callable[[OperatorCommand], None]

    async def run(self, alive: Callable[[], None]) -> None:
        """Poll for operator commands until cancelled. alive: called twenty times a second."""
        while True:
            alive()
            while (command := self.inbox.poll()) is not None:
                self._pass_on(command)
                self.record(command)
                self.acknowledge(command)
            await asyncio.sleep(_POLL_S)

    def _pass_on(self, command: OperatorCommand) -> None:
        if command.kind == "geofence":
            self.fence_changes.ask(command)
        else:
            self.guard.send(OperatorAction(command))


def operator_handler_of(
    setup: RunSetup,
    pair: VehiclePair,
    oracle_runner: OracleRunner,
    *,
    reporter: RunProgressReporter,
    recorder: RunRecorder,
    inbox: OperatorInbox,
    onboard_fences: OnboardFences,
) -> OperatorHandler:
    """Return the handler of a run's operator commands."""

    def answer(command: OperatorCommand, ok: bool, text: str) -> None:
        recorder.note("answer", kind=command.kind, who=command.who, ok=ok, text=text)
        reporter.answer(command, ok, text)

    fence_changes = FenceChanges(
        guard=pair.guard,
        onboard_fences=onboard_fences,
        frame=setup.case.world.frame,
        fences=dict(setup.case.fences.items()),
        flying=tuple(vehicle.name for vehicle in setup.vehicles),
        changed=oracle_runner.change_fences,
        answer=answer,
    )
    pair.guard.on_event(fence_changes.receive)
    return OperatorHandler(
        inbox=inbox,
        guard=pair.guard,
        fence_changes=fence_changes,
        record=recorder.operator,
        acknowledge=reporter.acknowledge,
    )
