"""Which guard stands over a run: in this process under virtual time, else in one of its own."""

import asyncio
import time
from collections.abc import Mapping

from orchestrator.run.hangar import SYSTEM_IDS, Hangar, InProcess, OwnProcesses
from orchestrator.run.setup import RunSetup
from safety.guard.charter import GuardCharter, Guarded
from safety.guard.events import GuardedVehicle
from safety.guard.remote import RemoteGuard
from safety.guard.shell import GuardLinks, GuardShell, Record
from vehicles.autopilots.base import Target
from vehicles.autopilots.registry import autopilot_named
from vehicles.links.base import Link
from vehicles.links.memory import memory_pair

Guard = GuardShell | RemoteGuard


def guard_of(setup: RunSetup, *, record: Record) -> tuple[Guard, Hangar, Mapping[str, Link]]:
    """Return the guard, the hangar that starts vehicles for it, and the links to it by vehicle.

    record: gets every frame under virtual time; under the wall clock the guard's process writes
    the logs of frames, and it gets the commands that went out.
    """
    guarded: dict[str, GuardedVehicle] = {
        vehicle.name: GuardedVehicle(
            autopilot=autopilot_named(vehicle.autopilot),
            target=Target(SYSTEM_IDS[vehicle.name]),
            fence=setup.campaign.fence,
        )
        for vehicle in setup.vehicles
    }
    if setup.clock == "virtual":
        return _in_process(setup, guarded, record)
    charter = GuardCharter(
        run=setup.order.plan.name,
        folder=str(setup.order.folder.absolute()),
        epoch_s=time.time() - asyncio.get_running_loop().time(),
        vehicles={name: Guarded(vehicle=vehicle) for name, vehicle in guarded.items()},
    )
    guard = RemoteGuard(charter=charter, record=record)
    return guard, OwnProcesses(setup, guard), {name: guard.link(name) for name in guarded}


def _in_process(
    setup: RunSetup, guarded: Mapping[str, GuardedVehicle], record: Record
) -> tuple[Guard, Hangar, Mapping[str, Link]]:
    hangar = InProcess(setup)
    inner: dict[str, GuardLinks] = {}
    outer: dict[str, Link] = {}
    for vehicle in setup.vehicles:
        near, outer[vehicle.name] = memory_pair(name=f"{vehicle.name} guard")
        inner[vehicle.name] = GuardLinks(vehicle=hangar.link(vehicle), orchestrator=near)
    return GuardShell(vehicles=guarded, links=inner, record=record), hangar, outer
