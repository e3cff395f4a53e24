"""Reports a run's progress twice a second while it flies, and each of its events at once."""

import asyncio
from collections.abc import Callable, Iterable, Mapping

from wil_campaign.campaigns.expansion.expansion import RunPlan
from wil_campaign.orchestrator.operator.run_messages import (
    HappeningKind,
    Report,
    RunEventReport,
    RunProgressReport,
    VehicleProgress,
)
from wil_campaign.orchestrator.run.perception.mixing_statistics import MixingStatistics
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.safety.guard.core.events import GuardEvent
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.model.oracle_results import Flag
from wil_campaign.safety.model.verdict import DecisiveEvent

PROGRESS_S = 0.5


class RunProgressReporter:
    """Reports the progress and the events of one run. kinds: of the oracles, by name."""

    def __init__(
        self,
        *,
        plan: RunPlan,
        report: Report,
        run_state: RunState,
        kinds: Mapping[str, str],
    ) -> None:
        self._plan = plan
        self._report = report
        self._run_state = run_state
        self._kinds = kinds
        run_state.on_stage(self._stage)
        run_state.on_decisive(self._decisive)

    def flag(self, flag: Flag) -> None:
        """Report a contact."""
        if self._kinds.get(flag.oracle) == "collision":
            self._report_event(
                "collision", flag.oracle, flag.text, t_s=flag.t_s, vehicle=flag.vehicle
            )

    def guard(self, event: GuardEvent) -> None:
        """Report an event of the guard."""
        self._report_event("guard", event.kind, event.text, t_s=event.t_s, vehicle=event.vehicle)

    def answer(self, command: OperatorCommand, ok: bool, text: str) -> None:
        """Report the outcome of an operator's command."""
        self._reply(command, "answer", "ok" if ok else "refused", text)

    def acknowledge(self, command: OperatorCommand) -> None:
        """Report that an operator's command has reached the run."""
        self._reply(command, "acknowledged", command.kind, "")

    async def follow(
        self,
        contexts: Iterable[VehicleContext],
        mixing: Callable[[], MixingStatistics | None],
        clearance_m: Callable[[float], float | None],
    ) -> None:
        """Report the run's progress twice a second until cancelled."""
        loop = asyncio.get_running_loop()
        run_state, plan, vehicles = self._run_state, self._plan, tuple(contexts)
        while True:
            statistics = mixing()
            self._report(
                RunProgressReport(
                    case=plan.case,
                    mode=plan.mode,
                    repetition=plan.repetition,
                    stage=run_state.stage,
                    t_s=loop.time(),
                    mixing_rate_hz=None if statistics is None else statistics.rate_hz,
                    skew_ms=None if statistics is None else statistics.skew_ms.last,
                    clearance_m=clearance_m(loop.time()),
                    verdict_so_far=run_state.decisive[0].kind if run_state.decisive else None,
                    vehicles=tuple(map(_vehicle_progress, vehicles)),
                )
            )
            await asyncio.sleep(PROGRESS_S)

    def _reply(self, command: OperatorCommand, kind: HappeningKind, word: str, text: str) -> None:
        self._report(
            RunEventReport(
                run=self._plan.name,
                t_s=asyncio.get_running_loop().time(),
                kind=kind,
                word=word,
                vehicle="",
                text=text,
                command_id=command.command_id,
                who=command.who,
            )
        )

    def _stage(self, stage: Stage, t_s: float) -> None:
        self._report_event("stage", stage, "", t_s=t_s)

    def _decisive(self, event: DecisiveEvent) -> None:
        self._report_event("decisive", event.kind, event.text, t_s=event.t_s)

    def _report_event(
        self, kind: HappeningKind, word: str, text: str, *, t_s: float, vehicle: str = ""
    ) -> None:
        self._report(
            RunEventReport(
                run=self._plan.name, t_s=t_s, kind=kind, word=word, vehicle=vehicle, text=text
            )
        )


def _vehicle_progress(context: VehicleContext) -> VehicleProgress:
    state, newest = context.driver.state, context.poses.latest()
    return VehicleProgress(
        name=context.name,
        armed=state.armed,
        mode=state.mode_name,
        landed=state.landed,
        position_ned_m=None if newest.pose is None else newest.pose.position_ned_m,
        velocity_ned_m_s=None if state.estimate is None else state.estimate.velocity_ned_m_s,
        battery_fraction=None if state.battery is None else state.battery.remaining,
    )
