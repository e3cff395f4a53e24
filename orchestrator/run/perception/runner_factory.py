"""Builds what flies each vehicle: the campaign's autonomy, an external program, or a coupling."""

from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager

from campaigns.setup.perceived_cameras import perceived_cameras
from orchestrator.external.program_runner import ProgramRunner
from orchestrator.run.perception.autonomy_calls import AutonomyFault, call_autonomy
from orchestrator.run.perception.autonomy_memory import MemoryMeter
from orchestrator.run.perception.autonomy_runner import AutonomyRunner
from orchestrator.run.perception.coupled_runners import FollowRunner, ShadowRunner
from orchestrator.run.vehicles.pair import Pair
from orchestrator.state.run_setup import RunSetup
from orchestrator.state.run_state import RunState
from orchestrator.state.vehicle_context import VehicleContext
from vehicles.autonomy import Autonomy
from vehicles.autopilots.autopilot import Target
from vehicles.process_memory import limited_allocation

AnyRunner = AutonomyRunner | ProgramRunner | FollowRunner | ShadowRunner


@asynccontextmanager
async def open_runners(
    setup: RunSetup, pair: Pair, run_state: RunState
) -> AsyncIterator[Mapping[str, AnyRunner]]:
    """Build the autonomy runners by vehicle; programs run while this is open.

    Raises AutonomyFault for an autonomy that cannot be built, VehicleError for a program that
    cannot be started.
    """
    runners: dict[str, AnyRunner] = {}
    under_test = setup.campaign.under_test
    memory = MemoryMeter(under_test.limits)
    async with AsyncExitStack() as stack:
        if under_test.program is None:
            stack.enter_context(limited_allocation(memory.backstop_mb))
        for context in pair.contexts:
            coupled = _coupled_runner(setup, pair, context, runners)
            if coupled is not None:
                runners[context.name] = coupled
            elif under_test.program is None:
                runners[context.name] = AutonomyRunner(
                    autonomy=_build_autonomy(setup, context.name, memory),
                    context=context,
                    run_state=run_state,
                    rate_hz=under_test.rate_hz,
                    memory=memory,
                    call_s=under_test.limits.call_s,
                )
            else:
                program = _program_runner(setup, pair, context, run_state)
                runners[context.name] = await stack.enter_async_context(program)
        yield runners


def _coupled_runner(
    setup: RunSetup, pair: Pair, context: VehicleContext, runners: Mapping[str, AnyRunner]
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
    """Build the autonomy of a vehicle for its runner. Raises AutonomyFault."""
    under_test = setup.campaign.under_test
    try:
        built = call_autonomy(
            lambda: under_test.build(setup.seed),
            within_s=under_test.limits.build_s,
            limit="build_s",
        )
    except AutonomyFault as fault:
        raise AutonomyFault(f"the autonomy of {name} {fault}", fault.trace, fault.kind) from None
    if excess := memory.excess():
        raise AutonomyFault(f"the autonomy of {name} {excess}", kind="ERROR")
    return built


def _program_runner(
    setup: RunSetup, pair: Pair, context: VehicleContext, run_state: RunState
) -> ProgramRunner:
    vehicle = setup.vehicle(context.name)
    cameras = perceived_cameras(setup.campaign, setup.mode, vehicle.name)
    return ProgramRunner(
        under_test=setup.campaign.under_test,
        context=context,
        link=pair.links[context.name],
        target=Target(vehicle.system_id),
        camera=next(iter(cameras), None),
        run_state=run_state,
        folder=setup.order.folder,
        seed=setup.seed,
    )
