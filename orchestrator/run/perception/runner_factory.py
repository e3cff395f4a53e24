"""Builds what flies each vehicle: the campaign's autonomy, a foreign one, or a coupling."""

from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager

from wil_campaign.hooks import autonomy_kinds
from wil_campaign.installed_plugins import added, load
from wil_campaign.orchestrator.run.perception.autonomy_calls import (
    AutonomyFault,
    call_autonomy,
    code_folder,
)
from wil_campaign.orchestrator.run.perception.autonomy_memory import MemoryMeter
from wil_campaign.orchestrator.run.perception.autonomy_runner import AutonomyRunner
from wil_campaign.orchestrator.run.perception.coupled_runners import FollowRunner, ShadowRunner
from wil_campaign.orchestrator.run.perception.foreign_runner import ForeignRunner, OpenedAutonomy
from wil_campaign.orchestrator.run.perception.stray_errors import StrayErrors
from wil_campaign.orchestrator.run.vehicles.pair import Pair
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.vehicles.autonomy import Autonomy
from wil_campaign.vehicles.process_memory import limited_allocation

AnyRunner = AutonomyRunner | ForeignRunner | FollowRunner | ShadowRunner


@asynccontextmanager
async def open_runners(
    setup: RunSetup, pair: Pair, run_state: RunState
) -> AsyncIterator[Mapping[str, AnyRunner]]:
    """Build the autonomy runners by vehicle; foreign ones run while this is open.

    Raises AutonomyFault for an autonomy that cannot be built, VehicleError for a foreign one that
    cannot be started.
    """
    runners: dict[str, AnyRunner] = {}
    under_test = setup.campaign.under_test
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
                make = load(added(autonomy_kinds)[under_test.foreign.kind].runner)
                foreign: ForeignRunner = make(setup, pair, context, run_state)
                runners[context.name] = await stack.enter_async_context(foreign)
            else:
                opened: OpenedAutonomy | None = None
                if under_test.foreign is not None:
                    opening = load(added(autonomy_kinds)[under_test.foreign.kind].open)
                    entering = opening(setup, pair, context, run_state)
                    found: OpenedAutonomy = await stack.enter_async_context(entering)
                    opened, autonomy = found, found.autonomy
                else:
                    autonomy = _build_autonomy(setup, context.name, memory)
                    if (folder := code_folder(autonomy)) is not None:
                        run_state.autonomy_folders.add(folder)
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
