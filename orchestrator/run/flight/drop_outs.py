"""Doing a thing with a vehicle until it is done, or the vehicle drops out of the flight."""

import asyncio
from collections.abc import Awaitable, Callable

from orchestrator.state.run_state import FlightError, RunState
from vehicles.errors import VehicleError


async def unless_out(
    vehicle: str, run_state: RunState, do: Callable[[], Awaitable[object]]
) -> None:
    """Do something with a vehicle until it drops out; its own errors are such a reason."""
    if vehicle in run_state.dropped_out:
        return
    loop = asyncio.get_running_loop()
    try:
        async with asyncio.timeout(None) as waiting:
            with run_state.watching_drop_out(vehicle, lambda: waiting.reschedule(loop.time())):
                await do()
    except (VehicleError, FlightError) as error:
        run_state.drop_out(vehicle, str(error))
    except TimeoutError:
        if not waiting.expired():
            raise
