"""Which guard stands over a run: in this process under virtual time, else in one of its own."""

import asyncio
import time
from collections.abc import Mapping
from dataclasses import replace

from campaigns.setup import LinkSetup, VehicleSetup
from orchestrator.recording.epoch import VIRTUAL_EPOCH_S
from orchestrator.run.hangar import Hangar, InProcess, OwnProcesses, vehicle_seed
from orchestrator.run.setup import RunSetup
from safety.guard.base import Guard
from safety.guard.charter import GuardCharter, Guarded
from safety.guard.events import GuardedVehicle, GuardSettings
from safety.guard.following import PaceSetup
from safety.guard.remote import RemoteGuard
from safety.guard.shell import GuardLinks, GuardShell, Record
from vehicles.autopilots.base import Target
from vehicles.autopilots.registry import autopilot_named
from vehicles.launch.prepared import PreparedLaunch
from vehicles.links.base import Link
from vehicles.links.conditions import LinkConditions, under_conditions
from vehicles.links.memory import memory_pair

_LINK_LUCK = 3
"""Keeps the luck of links apart from that of other things with the same seed."""

HANGING_S = 1.0
"""How long an orchestrator on a busy computer may be silent under the wall clock. The end of its
process is seen at once, and the guard watches the fence meanwhile; from 1 s on PX4 falls into its
own failsafe for want of setpoints anyway."""


def guard_of(
    setup: RunSetup, *, record: Record, prepared: Mapping[str, PreparedLaunch]
) -> tuple[Guard, Hangar, Mapping[str, Link]]:
    """Return the guard, the hangar that starts vehicles for it, and the links to it by vehicle.

    prepared: the simulators that are going to be launched. record: gets every frame under virtual
    time; under the wall clock the guard's process writes the logs of frames, and it gets the
    commands that went out.
    """
    guarded: dict[str, GuardedVehicle] = {
        vehicle.name: GuardedVehicle(
            autopilot=autopilot_named(vehicle.autopilot),
            target=Target(vehicle.system_id),
            limits=setup.campaign.limits,
            attached=vehicle.attached is not None,
            gcs=setup.clock != "virtual" and vehicle.name in setup.campaign.gcs,
            fence=setup.campaign.fences.get(vehicle.name),
        )
        for vehicle in setup.vehicles
    }
    keeping = setup.campaign.guarding
    settings = GuardSettings(
        keep_m=keeping.keep_m, latency_s=keeping.latency_s, braking_m_s2=keeping.braking_m_s2
    )
    if setup.clock == "virtual":
        return _in_process(setup, guarded, settings, record)
    charter = GuardCharter(
        run=setup.order.plan.name,
        folder=str(setup.order.folder.absolute()),
        epoch_s=time.time() - asyncio.get_running_loop().time(),
        vehicles={
            one.name: Guarded(
                vehicle=guarded[one.name],
                link=_address(one, prepared),
                patient=one.launch is not None,
                gcs=setup.campaign.gcs.get(one.name, ""),
                spares=tuple(map(str, one.spares)),
                conditions=conditions_of(setup, one),
            )
            for one in setup.vehicles
        },
        settings=replace(settings, orchestrator_silent_s=HANGING_S * setup.pace),
        pace=_pace_of(setup),
    )
    guard = RemoteGuard(charter=charter, record=record)
    hangar = OwnProcesses(setup, guard, prepared)
    return guard, hangar, {name: guard.link(name) for name in guarded}


def _pace_of(setup: RunSetup) -> PaceSetup | None:
    """Return how the scaled clock goes: by a simulation with a pace of its own, where one flies."""
    if setup.clock != "scaled":
        return None
    leader = next((one for one in setup.vehicles if one.launch is not None), setup.vehicles[0])
    return PaceSetup(nominal=setup.pace, leader=leader.name, follows_us=leader.launch is None)


def _address(vehicle: VehicleSetup, prepared: Mapping[str, PreparedLaunch]) -> str:
    """Return the link string to a vehicle; empty for a port of the guard's choice."""
    if vehicle.name in prepared:
        return str(prepared[vehicle.name].plan.link)
    return "" if vehicle.attached is None else str(vehicle.attached)


def conditions_of(setup: RunSetup, vehicle: VehicleSetup) -> LinkConditions:
    """Return how frames fare between the guard and a vehicle, by the run's seed."""
    link = setup.campaign.links.get(vehicle.name, LinkSetup())
    return LinkConditions(
        outgoing=link.outgoing,
        incoming=link.incoming,
        seed=(vehicle_seed(setup.seed, vehicle.name), _LINK_LUCK),
        may_go_dark=bool(link.blackouts),
        signing=vehicle.signing,
    )


def _in_process(
    setup: RunSetup,
    guarded: Mapping[str, GuardedVehicle],
    settings: GuardSettings,
    record: Record,
) -> tuple[Guard, Hangar, Mapping[str, Link]]:
    hangar = InProcess(setup)
    inner: dict[str, GuardLinks] = {}
    outer: dict[str, Link] = {}
    for vehicle in setup.vehicles:
        near, outer[vehicle.name] = memory_pair(name=f"{vehicle.name} guard")
        there = under_conditions(
            hangar.link(vehicle), conditions_of(setup, vehicle), utc_s=VIRTUAL_EPOCH_S
        )
        inner[vehicle.name] = GuardLinks(
            vehicle=there.link, orchestrator=near, impaired=there.impaired
        )
    guard = GuardShell(vehicles=guarded, links=inner, settings=settings, record=record)
    return guard, hangar, outer
