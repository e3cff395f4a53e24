"""The goal: all runners start at one time t0 and fly until the subject is done."""

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from wil_campaign.foundation.tasks import open_task_group, stop_tasks
from wil_campaign.orchestrator.run.perception.autonomy_runner import AutonomyRunner
from wil_campaign.orchestrator.run.perception.runner_factory import AnyRunner
from wil_campaign.orchestrator.run.stages.drop_outs import unless_dropped_out
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.safety.model.verdict import GOAL_TIMEOUT

_OTHERS_S = 2.0
"""How much longer than the real vehicle the twin may take to be done."""


@dataclass(frozen=True, slots=True)
class GoalFlight:
    """Flies the goal with the autonomy runner of every vehicle.

    events: gets t0 as the world's event "goal"; notify: called with it as well. started: called
    when each vehicle got its first setpoint. within_s: time limit of the subject. companion: a
    vehicle that flies beside the subject, and may drop out.
    """

    runners: Mapping[str, AnyRunner]
    subject: str
    run_state: RunState
    events: dict[str, float]
    started: Callable[[str, float], None]
    notify: Callable[[str, float], None]
    within_s: float
    companion: str | None = None

    def holding_autonomy(self) -> tuple[str, str] | None:
        """Return the vehicle whose autonomy has lately kept the loop from running, and how."""
        for name, runner in self.runners.items():
            if isinstance(runner, AutonomyRunner) and (held := runner.held_up()):
                return name, held
        return None

    async def fly(self, t0_s: float) -> None:
        """Fly the goal; return when the subject's autonomy is done, and the other's was awaited.

        A subject that is not done in time FAILs the run, whatever its oracles require.
        """
        self.events["goal"] = t0_s
        self.notify("goal", t0_s)
        for runner in self.runners.values():
            runner.on_first_setpoint(self.started)
        try:
            async with asyncio.timeout(self.within_s), open_task_group() as tasks:
                flying = [
                    tasks.create_task(self._fly_vehicle(name, runner), name=f"{name} autonomy")
                    for name, runner in self.runners.items()
                ]
                await self._await_done()
                await stop_tasks(*flying)
        except TimeoutError:
            reason = (
                f"the autonomy of {self.subject} was not done {self.within_s:g} s after its goal"
            )
            self.run_state.decide("FAIL", f"{reason} (sync.goal_timeout_s)", source=GOAL_TIMEOUT)

    async def _fly_vehicle(self, name: str, runner: AnyRunner) -> None:
        if name == self.companion:
            await unless_dropped_out(name, self.run_state, runner.fly)
        else:
            await runner.fly()

    async def _await_done(self) -> None:
        await self.runners[self.subject].done.wait()
        self.run_state.enter("done")
        not_awaited = {self.subject, *self.run_state.dropped_out}
        others = [
            runner.done.wait() for name, runner in self.runners.items() if name not in not_awaited
        ]
        try:
            async with asyncio.timeout(_OTHERS_S):
                await asyncio.gather(*others)
        except TimeoutError:
            return
