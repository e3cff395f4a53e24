"""Runs the autonomy under test on a vehicle: telemetry and readings in, setpoints out."""

import asyncio
from collections.abc import Callable

from wil_campaign.foundation.clocks.sleeping import sleep_until
from wil_campaign.orchestrator.run.perception.autonomy_calls import AutonomyFault
from wil_campaign.orchestrator.run.perception.autonomy_lane import (
    LONGEST_BEHIND_S,
    AutonomyLane,
    LoopLane,
    ThreadLane,
)
from wil_campaign.orchestrator.run.perception.autonomy_memory import MemoryMeter
from wil_campaign.orchestrator.run.perception.foreign_runner import OpenedAutonomy
from wil_campaign.orchestrator.run.perception.stray_errors import StrayErrors, decide_fault
from wil_campaign.orchestrator.run_results.result_parts import ProgramResult
from wil_campaign.orchestrator.run_results.run_result import SlowAutonomy
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.vehicles.autonomy import Autonomy, PerceivesRaw
from wil_campaign.vehicles.readings import Reading
from wil_campaign.vehicles.setpoints import Setpoint

SetpointListener = Callable[[Setpoint, float], None]


class AutonomyRunner:
    """Runs one autonomy on one vehicle at `rate_hz`.

    A fault of the autonomy is a FAIL of the run and no ERROR: it is what is under test. memory:
    checked after each call; beyond its limit the run is an ERROR before the goal, and a FAIL from
    then on. call_s: limit of one call, wall time. strays: what its threads raise decides, too.
    beside: a thread makes the calls, so that they do not hold up the loop: on the wall clock.
    opened: of a foreign autonomy, for its result.
    """

    def __init__(
        self,
        *,
        autonomy: Autonomy,
        context: VehicleContext,
        run_state: RunState,
        rate_hz: float,
        memory: MemoryMeter,
        call_s: float,
        strays: StrayErrors,
        beside: bool = False,
        opened: OpenedAutonomy | None = None,
    ) -> None:
        self.context = context
        self._opened = opened
        self._autonomy = autonomy
        self._run_state = run_state
        self._rate_hz = rate_hz
        self._memory = memory
        self._strays = strays
        self._lane: AutonomyLane = (
            ThreadLane(
                name=context.name,
                rate_hz=rate_hz,
                call_s=call_s,
                check=self._check_memory,
                fault=self._report_fault,
            )
            if beside
            else LoopLane(name=context.name, call_s=call_s, check=self._check_memory)
        )
        self._needed_s = self._had_s = 0.0
        self._crashed = False
        self._started: Callable[[str, float], None] | None = None
        self._setpoint_listeners: list[SetpointListener] = []
        self.done = asyncio.Event()

    def on_setpoint(self, listener: SetpointListener) -> None:
        """Call `listener(setpoint, t_s)` with each setpoint, once it is sent."""
        self._setpoint_listeners.append(listener)

    def on_first_setpoint(self, started: Callable[[str, float], None]) -> None:
        """Call `started(name, t_s)` once, when the autonomy's next setpoint is sent."""
        self._started = started

    def perceive(self, reading: Reading) -> None:
        """Give a reading to the autonomy."""
        self._call_guarded("perceive", self._autonomy.perceive, reading)

    def perceive_raw(self, reading: Reading) -> None:
        """Give a mixture's input reading to an autonomy that perceives raw readings."""
        if isinstance(self._autonomy, PerceivesRaw):
            self._call_guarded("perceive_raw", self._autonomy.perceive_raw, reading)

    def _call_guarded(
        self, method: str, perceive: Callable[[Reading], object], reading: Reading
    ) -> None:
        if self._crashed:
            return
        try:
            self._lane.offer(perceive, reading, method)
            self._strays.decide()
        except AutonomyFault as fault:
            self._report_fault(fault)

    async def fly(self) -> None:
        """Run the autonomy until cancelled; set `done` when it reports its goal reached."""
        loop = asyncio.get_running_loop()
        t0_s, tick = loop.time(), 0
        before_s = self._spent_s()
        try:
            while not self._crashed:
                await self._act()
                tick = max(tick + 1, int((loop.time() - t0_s) * self._rate_hz))
                await sleep_until(t0_s + tick / self._rate_hz)
        finally:
            self._needed_s, self._had_s = self._spent_s() - before_s, loop.time() - t0_s

    @property
    def slow(self) -> SlowAutonomy | None:
        """Return how much longer than its goal the autonomy's calls took, where that is too much.

        On a clock that waits for them: on the wall clock such an autonomy fails.
        """
        if self._needed_s - self._had_s <= LONGEST_BEHIND_S:
            return None
        return SlowAutonomy(self.context.name, self._needed_s, self._had_s)

    @property
    def result(self) -> ProgramResult | None:
        """Return how a foreign autonomy ended; None for a class."""
        return None if self._opened is None else self._opened.result

    def held_up(self) -> str:
        """Return in words how the autonomy has lately kept the loop from running; "" if not."""
        return self._lane.held_up()

    def close(self) -> None:
        """End the autonomy's calls."""
        self._lane.close()

    def _spent_s(self) -> float:
        return self._lane.act_times.total_s + self._lane.perceive_times.total_s

    async def _act(self) -> None:
        telemetry = self.context.telemetry()
        if telemetry is None:
            return
        try:
            command = await self._lane.act(lambda: self._autonomy.act(telemetry))
            self._strays.decide()
        except AutonomyFault as fault:
            self._report_fault(fault)
            return
        now_s = asyncio.get_running_loop().time()
        self.context.driver.send(command.setpoint)
        self.context.setpoint = command.setpoint
        self.context.take_note(now_s, command.note)
        for listener in self._setpoint_listeners:
            listener(command.setpoint, now_s)
        if self._started is not None:
            self._started(self.context.name, now_s)
            self._started = None
        if command.done:
            self.done.set()

    def _check_memory(self) -> None:
        """Check the run's memory after a call. Raises AutonomyFault."""
        if excess := self._memory.excess():
            raise AutonomyFault(excess, kind="ERROR")

    def _report_fault(self, fault: AutonomyFault) -> None:
        self._crashed = True
        decide_fault(self._run_state, self.context.name, fault)
