"""The goal: given to all pilots at one moment, flown until the subject is done."""

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from orchestrator.run.perception.runner_factory import AnyRunner
from orchestrator.run.stages.drop_outs import unless_out
from orchestrator.state.run_state import RunState
from safety.model.verdict import GOAL_TIMEOUT
from vehicles.tasks import stop, together

_OTHERS_S = 2.0
"""How long the twin may take longer than the real vehicle to say that it is done."""


@dataclass(frozen=True, slots=True)
class GoalFlight:
    """Flies the goal with the autonomy runner of every vehicle.

    events: learns of t0 as the world's event "goal"; notify: told of it as well. started: told
    when each vehicle got its first setpoint. within_s: how long the subject is given. companion: a
    vehicle that flies beside it, and may drop out.
    """

    runners: Mapping[str, AnyRunner]
    subject: str
    run_state: RunState
    events: dict[str, float]
    started: Callable[[str, float], None]
    notify: Callable[[str, float], None]
    within_s: float
    companion: str | None = None

    async def fly(self, t0_s: float) -> None:
        """Fly the goal; return when the subject's autonomy is done, and the other's awaited.

        One that is not done in time FAILs the run, whatever its oracles ask: it would never end.
        """
        self.events["goal"] = t0_s
        self.notify("goal", t0_s)
        for runner in self.runners.values():
            runner.on_first_setpoint(self.started)
        try:
            async with asyncio.timeout(self.within_s), together() as tasks:
                flying = [
                    tasks.create_task(self._fly_vehicle(name, runner), name=f"{name} autonomy")
                    for name, runner in self.runners.items()
                ]
                await self._is_done()
                await stop(*flying)
        except TimeoutError:
            said = f"the autonomy of {self.subject} was not done {self.within_s:g} s after its goal"
            self.run_state.decide("FAIL", f"{said} (sync.goal_timeout_s)", source=GOAL_TIMEOUT)

    async def _fly_vehicle(self, name: str, runner: AnyRunner) -> None:
        if name == self.companion:
            await unless_out(name, self.run_state, runner.fly)
        else:
            await runner.fly()

    async def _is_done(self) -> None:
        await self.runners[self.subject].done.wait()
        self.run_state.enter("done")
        gone = {self.subject, *self.run_state.dropped_out}
        others = [one.done.wait() for name, one in self.runners.items() if name not in gone]
        try:
            async with asyncio.timeout(_OTHERS_S):
                await asyncio.gather(*others)
        except TimeoutError:
            return
