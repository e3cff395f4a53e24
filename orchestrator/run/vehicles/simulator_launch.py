"""Launches the simulators of a run: prepared before the guard opens its links, started by it."""

import math
from collections.abc import Mapping
from contextlib import AsyncExitStack
from dataclasses import replace
from functools import partial

from wil_campaign.campaigns.setup.vehicle_setups import FlownSetup
from wil_campaign.foundation.tasks import start_task, stop_tasks
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.safety.guard.process.remote_guard import RemoteGuard
from wil_campaign.vehicles.launch import LaunchHome, ReservedLaunch, SimulatorLaunch


def prepare_launches(setup: RunSetup, stack: AsyncExitStack) -> Mapping[str, ReservedLaunch]:
    """Reserve folder and instance of every simulator to launch; the stack releases them.

    Raises LaunchError when something is missing. Nothing is started.
    """
    prepared: dict[str, ReservedLaunch] = {}
    for vehicle in setup.guarded:
        if vehicle.launch is None:
            continue
        one = _at_start(vehicle.launch, setup, vehicle).prepare(
            folder=(setup.order.folder / f"{vehicle.name}-sitl").absolute(),
            system_id=vehicle.system_id,
        )
        stack.enter_context(one)
        stack.push_async_callback(one.clean_up)
        prepared[vehicle.name] = one
    return prepared


async def start_simulators(name: str, prepared: ReservedLaunch, guard: RemoteGuard) -> None:
    """Have the guard launch a simulator, and wait for it. Raises LinkError, LaunchError."""
    end = start_task(guard.end_of(name), name=f"end of {name}")
    try:
        await prepared.start(partial(guard.start, name), end)
    finally:
        await stop_tasks(end)


def _at_start(launch: SimulatorLaunch, setup: RunSetup, vehicle: FlownSetup) -> SimulatorLaunch:
    """Return the simulator's launch at the vehicle's start in the world."""
    place = setup.case.world.frame.to_geodetic(vehicle.start.position_ned_m)
    home = LaunchHome(
        latitude_deg=place.latitude_deg,
        longitude_deg=place.longitude_deg,
        altitude_m=place.altitude_m,
        heading_deg=math.degrees(vehicle.start.yaw_rad) % 360.0,
    )
    return replace(launch, home=home)
