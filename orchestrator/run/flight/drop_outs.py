"""Doing a thing with a vehicle until it is done, or the vehicle drops out of the flight."""

import asyncio
from collections.abc import Awaitable, Callable

from orchestrator.state.run_state import FlightError, RunState
from vehicles.errors import VehicleError


async def unless_out(
    vehicle: str,
    run_state: RunState,
    do: Callable[[], Awaitable[object]],
    *,
    repeated: bool = False,
) -> None:
    """Do something with a vehicle until it drops out; its own errors are such a reason.

    repeated: the caller does it again after an operator's hold: errors that a hold came between are
    raised then, for they are the hold's and not the vehicle's.
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
