"""Runs a step with vehicles concurrently, each until it is done or the vehicle drops out."""

import asyncio
from collections.abc import Awaitable, Callable, Iterable

from wil_campaign.foundation.tasks import raising_first_task_error
from wil_campaign.orchestrator.state.run_state import FlightError, RunState
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.vehicles.errors import VehicleError


async def unless_dropped_out(
    vehicle: str,
    run_state: RunState,
    do: Callable[[], Awaitable[object]],
    *,
    repeated: bool = False,
) -> None:
    """Run a step with a vehicle until it drops out; an error of the step makes it drop out.

    repeated: the caller repeats the step after an operator's hold: an error during which a hold
    began is raised then, for the hold caused it and not the vehicle.
    """
    if vehicle in run_state.dropped_out:
        return
    loop, holds = asyncio.get_running_loop(), run_state.holds
    try:
        async with asyncio.timeout(None) as waiting:
            with run_state.watching_drop_out(vehicle, lambda: waiting.reschedule(loop.time())):
                await do()
    except (VehicleError, FlightError) as error:
        if repeated and run_state.holds != holds:
            raise
        run_state.drop_out(vehicle, str(error))
    except TimeoutError:
        if not waiting.expired():
            raise


async def each_vehicle(
    contexts: Iterable[VehicleContext], do: Callable[[VehicleContext], Awaitable[object]]
) -> None:
    """Run a step with all vehicles concurrently; the first error cancels the others."""

    async def one(context: VehicleContext) -> None:
        await do(context)

    with raising_first_task_error(VehicleError, FlightError):
        async with asyncio.TaskGroup() as group:
            for context in contexts:
                group.create_task(one(context), name=f"{context.name} stage")


async def each_remaining_vehicle(
    contexts: Iterable[VehicleContext],
    run_state: RunState,
    do: Callable[[VehicleContext], Awaitable[object]],
) -> None:
    """Run a step with each vehicle of the pair until it is done or has dropped out."""

    async def one(context: VehicleContext) -> None:
        if not context.may_drop_out:
            await do(context)
        else:
            await unless_dropped_out(context.name, run_state, lambda: do(context), repeated=True)

    await each_vehicle(contexts, one)
