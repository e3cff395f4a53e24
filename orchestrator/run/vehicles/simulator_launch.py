"""Launches the simulators of a run: prepared before the guard opens its links, started by it."""

import math
from collections.abc import Mapping
from contextlib import AsyncExitStack
from dataclasses import replace

from wil_campaign.campaigns.setup.vehicle_setups import FlownSetup
from wil_campaign.foundation.tasks import start, stop
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.safety.guard.process.remote_guard import RemoteGuard
from wil_campaign.vehicles.launch.launch_plan import Home, Launch
from wil_campaign.vehicles.launch.prepared_launch import PreparedLaunch

_READY_S = 60.0
"""Start time limit: a loaded machine, or a container image that starts cold."""
_GRACE_S = 2.0
"""How long a simulator may take to end; less than the guard allows its children."""


def prepare_launches(setup: RunSetup, stack: AsyncExitStack) -> Mapping[str, PreparedLaunch]:
    """Reserve folder and instance of every simulator to launch; the stack releases them.

    Raises LaunchError when something is missing. Nothing is started.
    """
    prepared: dict[str, PreparedLaunch] = {}
    for vehicle in setup.guarded:
        if vehicle.launch is None:
            continue
        one = PreparedLaunch(
            launch=_at_start(vehicle.launch, setup, vehicle),
            folder=(setup.order.folder / f"{vehicle.name}-sitl").absolute(),
            system_id=vehicle.system_id,
        )
        stack.enter_context(one)
        stack.push_async_callback(one.clean_up)
        prepared[vehicle.name] = one
    return prepared


async def start_simulators(name: str, prepared: PreparedLaunch, guard: RemoteGuard) -> None:
    """Have the guard launch a simulator, and wait for it. Raises LinkError, LaunchError."""
    end = start(guard.end_of(name), name=f"end of {name}")
    try:
        # It lives on the lifeline of guard and orchestrator, not on one of them alone.
        command = prepared.command(parent=0, grace_s=_GRACE_S)
        prepared.note(await guard.start(name, command, dict(prepared.plan.environment)))
        await prepared.until_ready(end, ready_s=_READY_S)
    finally:
        await stop(end)


def _at_start(launch: Launch, setup: RunSetup, vehicle: FlownSetup) -> Launch:
    """Return the simulator's launch at the vehicle's start in the world."""
    place = setup.case.world.frame.to_geodetic(vehicle.start.position_ned_m)
    home = Home(
        latitude_deg=place.latitude_deg,
        longitude_deg=place.longitude_deg,
        altitude_m=place.altitude_m,
        heading_deg=math.degrees(vehicle.start.yaw_rad) % 360.0,
    )
    return replace(launch, home=home)
