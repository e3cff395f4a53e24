"""Builds what flies each vehicle: the campaign's autonomy, a foreign one, or a coupling.

Runners of a twin that is coupled to the real vehicle, instead of an autonomy of its own.
"""

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

from wil_campaign.foundation.clocks.sleeping import sleep_until
from wil_campaign.foundation.processes.process_memory import limited_allocation
from wil_campaign.hooks import autonomy_kinds
from wil_campaign.installed_plugins import load_plugin_object, plugin_additions
from wil_campaign.orchestrator.run.perception.autonomy_calls import (
    AutonomyFault,
    call_autonomy,
    code_folder,
)
from wil_campaign.orchestrator.run.perception.autonomy_memory import MemoryMeter
from wil_campaign.orchestrator.run.perception.autonomy_runner import AutonomyRunner
from wil_campaign.orchestrator.run.perception.foreign_runner import ForeignRunner, OpenedAutonomy
from wil_campaign.orchestrator.run.perception.stray_errors import StrayErrors
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.vehicles.autonomy import Autonomy
from wil_campaign.vehicles.coupling import following_setpoint
from wil_campaign.vehicles.readings import Reading
from wil_campaign.vehicles.setpoints import Setpoint, VelocitySetpoint
from wil_campaign.worlds.frames import scale, subtract

_RATE_HZ = 50.0
_OLD_S = 0.5
"""Older poses and setpoints are not used: the twin hovers until newer ones arrive."""
_OVER_S = 0.2
"""Time over which an acceleration is computed: in less, the estimate's noise would dominate."""
_STILL = VelocitySetpoint((0.0, 0.0, 0.0))


class CoupledRunner:
    """Base of the coupled runners: they perceive nothing, and are always done."""

    def __init__(self, *, context: VehicleContext) -> None:
        self.context = context
        self._started: Callable[[str, float], None] | None = None
        self.done = asyncio.Event()
        self.done.set()

    def on_first_setpoint(self, started: Callable[[str, float], None]) -> None:
        """Call `started(name, t_s)` once, when the next setpoint is sent."""
        self._started = started

    def perceive(self, reading: Reading) -> None:
        """Ignore a reading: a coupled twin has no autonomy that perceives."""

    def perceive_raw(self, reading: Reading) -> None:
        """Ignore a mixture's input reading."""

    def _send(self, setpoint: Setpoint, now_s: float) -> None:
        self.context.driver.send(setpoint)
        self.context.setpoint = setpoint
        if self._started is not None:
            self._started(self.context.name, now_s)
            self._started = None


class FollowRunner(CoupledRunner):
    """Flies a vehicle after a leader, by the poses of both."""

    def __init__(self, *, context: VehicleContext, leader: VehicleContext) -> None:
        super().__init__(context=context)
        self._leader = leader
        self._own: PoseSample | None = None
        self._leads: deque[PoseSample] = deque()
        context.on_pose(self._receive_own)
        leader.on_pose(self._receive_leader)

    async def fly(self) -> None:
        """Follow from now on until cancelled."""
        loop = asyncio.get_running_loop()
        t0_s, tick = loop.time(), 0
        while True:
            self._send(self._setpoint(loop.time()), loop.time())
            tick = max(tick + 1, int((loop.time() - t0_s) * _RATE_HZ))
            await sleep_until(t0_s + tick / _RATE_HZ)

    def _receive_own(self, sample: PoseSample) -> None:
        self._own = sample

    def _receive_leader(self, sample: PoseSample) -> None:
        self._leads.append(sample)
        while sample.t_s - self._leads[0].t_s > _OVER_S:
            self._leads.popleft()

    def _setpoint(self, now_s: float) -> Setpoint:
        own = self._own
        if own is None or not self._leads or now_s - min(self._leads[-1].t_s, own.t_s) > _OLD_S:
            return _STILL
        leader, earlier = self._leads[-1], self._leads[0]
        commanded = self._leader.setpoint
        gained_m_s = subtract(leader.velocity_ned_m_s, earlier.velocity_ned_m_s)
        return following_setpoint(
            leader=leader.pose,
            velocity_ned_m_s=leader.velocity_ned_m_s,
            acceleration_ned_m_s2=scale(gained_m_s, 1.0 / _OVER_S),
            age_s=now_s - leader.t_s,
            own=own.pose,
            own_age_s=now_s - own.t_s,
            asked_ned_m_s=commanded.velocity_ned_m_s
            if isinstance(commanded, VelocitySetpoint)
            else None,
        )


class ShadowRunner(CoupledRunner):
    """Sends a vehicle the setpoints of its leader's autonomy, each when the leader gets it."""

    def __init__(self, *, context: VehicleContext, leader: AutonomyRunner) -> None:
        super().__init__(context=context)
        self._flies = False
        self._early: tuple[Setpoint, float] | None = None
        leader.on_setpoint(self._receive)

    async def fly(self) -> None:
        """Send the leader's setpoints until cancelled; first the one that came just before."""
        self._flies = True
        now_s = asyncio.get_running_loop().time()
        if self._early is not None and now_s - self._early[1] <= _OLD_S:
            # Both runners start in one turn of the loop, and the leader's autonomy acts at once.
            self._send(self._early[0], now_s)
        try:
            await asyncio.Event().wait()
        finally:
            self._flies, self._early = False, None

    def _receive(self, setpoint: Setpoint, now_s: float) -> None:
        if self._flies:
            self._send(setpoint, now_s)
        else:
            self._early = (setpoint, now_s)


AnyRunner = AutonomyRunner | ForeignRunner | FollowRunner | ShadowRunner


@asynccontextmanager
async def open_runners(
    setup: RunSetup, pair: VehiclePair, run_state: RunState
) -> AsyncIterator[Mapping[str, AnyRunner]]:
    """Build the autonomy runners by vehicle; foreign ones run while this is open.

    Raises AutonomyFault for an autonomy that cannot be built, VehicleError for a foreign one that
    cannot be started.
    """
    runners: dict[str, AnyRunner] = {}
    under_test = setup.case.under_test
    memory = MemoryMeter(under_test.limits)
    async with AsyncExitStack() as stack:
        if not under_test.has_runner:
            stack.enter_context(limited_allocation(memory.backstop_mb))
        strays = stack.enter_context(StrayErrors(run_state, setup.subject))
        for context in pair.contexts:
            coupled = _coupled_runner(setup, pair, context, runners)
            if coupled is not None:
                runners[context.name] = coupled
            elif under_test.foreign is not None and under_test.has_runner:
                make = load_plugin_object(
                    plugin_additions(autonomy_kinds)[under_test.foreign.kind].runner
                )
                foreign: ForeignRunner = make(setup, pair, context, run_state)
                runners[context.name] = await stack.enter_async_context(foreign)
            else:
                opened: OpenedAutonomy | None = None
                if under_test.foreign is not None:
                    opening = load_plugin_object(
                        plugin_additions(autonomy_kinds)[under_test.foreign.kind].open
                    )
                    entering = opening(setup, pair, context, run_state)
                    found: OpenedAutonomy = await stack.enter_async_context(entering)
                    opened, autonomy = found, found.autonomy
                else:
                    autonomy = _build_autonomy(setup, context.name, memory)
                    if (folder := code_folder(autonomy)) is not None:
                        run_state.autonomy_folders.add(folder)
                        run_state.step_files = _step_files(setup)
                runners[context.name] = runner = AutonomyRunner(
                    autonomy=autonomy,
                    context=context,
                    run_state=run_state,
                    rate_hz=under_test.rate_hz,
                    memory=memory,
                    call_s=under_test.limits.call_s,
                    strays=strays,
                    beside=setup.clock == "wall",
                    opened=opened,
                )
                stack.callback(runner.close)
        yield runners


def _step_files(setup: RunSetup) -> frozenset[Path]:
    """Return the files of the recipe's own steps, without that of the autonomy."""
    recipe, under_test = setup.case.recipe, setup.case.under_test
    if recipe is None:
        return frozenset()
    folder = recipe.document.path.parent
    files = {(folder / one.rpartition(":")[0]).resolve() for one in recipe.references()}
    return frozenset(
        files - {(under_test.folder / (under_test.use or "").rpartition(":")[0]).resolve()}
    )


def _coupled_runner(
    setup: RunSetup, pair: VehiclePair, context: VehicleContext, runners: Mapping[str, AnyRunner]
) -> FollowRunner | ShadowRunner | None:
    """Return the runner of a twin without an autonomy of its own; None for other vehicles."""
    if context.name != setup.companion:
        return None
    coupling = setup.vehicle(context.name).coupling
    if coupling == "follow":
        leader = next(one for one in pair.contexts if one.name == setup.subject)
        return FollowRunner(context=context, leader=leader)
    autonomy = runners.get(setup.subject)
    if coupling == "shadow" and isinstance(autonomy, AutonomyRunner):
        return ShadowRunner(context=context, leader=autonomy)
    return None


def _build_autonomy(setup: RunSetup, name: str, memory: MemoryMeter) -> Autonomy:
    under_test = setup.case.under_test
    try:
        built = call_autonomy(
            lambda: under_test.build(setup.seed),
            within_s=under_test.limits.build_s,
            limit="build_s",
        )
    except AutonomyFault as fault:
        # Nothing is armed yet: without it the test did not take place.
        raise AutonomyFault(f"the autonomy of {name} {fault}", fault.trace, "ERROR") from None
    if excess := memory.excess():
        raise AutonomyFault(f"the autonomy of {name} {excess}", kind="ERROR")
    return built
