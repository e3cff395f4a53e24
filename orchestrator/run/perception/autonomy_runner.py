"""Runs the autonomy under test on a vehicle: telemetry and readings in, setpoints out."""

import asyncio
from collections.abc import Callable
from typing import TypeVar

from orchestrator.run.perception.autonomy_calls import AutonomyFault, call_autonomy, command_of
from orchestrator.run.perception.autonomy_memory import MemoryMeter
from orchestrator.state.run_state import RunState
from orchestrator.state.vehicle_context import VehicleContext
from vehicles.autonomy import Autonomy, PerceivesRaw
from vehicles.cameras.rendered_cameras import sleep_until
from vehicles.readings import Reading
from vehicles.readings.copies import copied
from vehicles.setpoints import Setpoint

T = TypeVar("T")
SetpointListener = Callable[[Setpoint, float], None]


class AutonomyRunner:
    """Runs one autonomy on one vehicle at `rate_hz`.

    A fault of the autonomy is a FAIL of the run and no ERROR: it is what is under test. memory:
    checked after each call; beyond its limit the run is an ERROR. call_s: limit of one call, wall
    time.
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
    ) -> None:
        self.context = context
        self._autonomy = autonomy
        self._run_state = run_state
        self._rate_hz = rate_hz
        self._memory = memory
        self._call_s = call_s
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
        self._call_guarded(self._autonomy.perceive, reading)

    def perceive_raw(self, reading: Reading) -> None:
        """Give a mixture's input reading to an autonomy that perceives raw readings."""
        if isinstance(self._autonomy, PerceivesRaw):
            self._call_guarded(self._autonomy.perceive_raw, reading)

    def _call_guarded(self, perceive: Callable[[Reading], None], reading: Reading) -> None:
        if self._crashed:
            return
        try:
            self._call(lambda: perceive(copied(reading)))
        except AutonomyFault as fault:
            self._report_fault(fault)

    async def fly(self) -> None:
        """Run the autonomy until cancelled; set `done` when it reports its goal reached."""
        loop = asyncio.get_running_loop()
        t0_s, tick = loop.time(), 0
        while not self._crashed:
            self._act(loop.time())
            tick = max(tick + 1, int((loop.time() - t0_s) * self._rate_hz))
            await sleep_until(t0_s + tick / self._rate_hz)

    def _act(self, now_s: float) -> None:
        telemetry = self.context.telemetry()
        if telemetry is None:
            return
        try:
            command = command_of(self._call(lambda: self._autonomy.act(telemetry)))
        except AutonomyFault as fault:
            self._report_fault(fault)
            return
        self.context.driver.send(command.setpoint)
        self.context.setpoint = command.setpoint
        self.context.note = command.note
        for listener in self._setpoint_listeners:
            listener(command.setpoint, now_s)
        if self._started is not None:
            self._started(self.context.name, now_s)
            self._started = None
        if command.done:
            self.done.set()

    def _call(self, call: Callable[[], T]) -> T:
        """Return the result of an autonomy call within its limits. Raises AutonomyFault."""
        answer = call_autonomy(call, within_s=self._call_s)
        if excess := self._memory.excess():
            raise AutonomyFault(excess, kind="ERROR")
        return answer

    def _report_fault(self, fault: AutonomyFault) -> None:
        self._crashed = True
        name = self.context.name
        reason = f"the autonomy of {name} {fault}"
        self._run_state.decide(fault.kind, reason, source=f"autonomy/{name}", trace=fault.trace)
