"""Builds the guard of a run: in this process under virtual time, else in a separate process."""

import asyncio
import time
from collections.abc import Mapping
from dataclasses import replace

from wil_campaign.campaigns.setup.vehicle_setups import FlownSetup
from wil_campaign.orchestrator.recording.timestamps import VIRTUAL_EPOCH_S
from wil_campaign.orchestrator.run.vehicles.vehicle_backends import (
    InProcessBackend,
    SubprocessBackend,
    VehicleBackend,
    vehicle_seed,
)
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.safety.guard.core.events import GuardedVehicle, GuardSettings
from wil_campaign.safety.guard.guard import Guard
from wil_campaign.safety.guard.local_guard import GuardLinks, LocalGuard, Record
from wil_campaign.safety.guard.process.guard_config import GuardConfig, GuardedVehicleConfig
from wil_campaign.safety.guard.process.remote_guard import RemoteGuard
from wil_campaign.safety.guard.process.run_clock import PaceSetup
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.launch import ReservedLaunch
from wil_campaign.vehicles.links.link import Link
from wil_campaign.vehicles.links.link_conditions import LinkConditions, link_under_conditions
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.worlds.scene.track import ObjectTrack

_LINK_SEED = 3
"""Separates the random draws of links from others with the same seed."""

HANGING_S = 1.0
"""How long the orchestrator may be silent under the wall clock, as on a busy computer. The guard
sees the end of its process at once, and watches the fence meanwhile; after 1 s without setpoints
PX4 enters its own failsafe anyway."""


def guard_of(
    setup: RunSetup,
    *,
    record: Record,
    prepared: Mapping[str, ReservedLaunch],
    tracks: Mapping[str, ObjectTrack],
) -> tuple[Guard, VehicleBackend, Mapping[str, Link]]:
    """Return the guard, the backend that starts vehicles for it, and its links by vehicle.

    tracks: positions of the world's objects that are flown by actors. prepared: the simulators to
    launch. record: called with every frame under virtual time; under the wall clock the guard's
    process logs the frames, and it is called with the commands that were sent.
    """
    pace = _pace_of(setup)
    # Without the simulation that leads the run clock all vehicles have to land.
    leader = None if pace is None else pace.leader
    guarded: dict[str, GuardedVehicle] = {
        vehicle.name: GuardedVehicle(
            autopilot=autopilot_named(vehicle.autopilot),
            target=MavlinkTarget(vehicle.system_id),
            # An actor follows its motion: the limits are for the autonomy under test.
            limits=None if vehicle in setup.actors else setup.case.limits,
            attached=vehicle.attached is not None,
            gcs=setup.clock != "virtual" and vehicle.name in setup.case.gcs,
            fence=setup.case.fences.get(vehicle.name),
            lands_alone=_lands_alone(setup, vehicle) and vehicle.name != leader,
            abandoned_when_lost=_is_abandoned_when_lost(setup, vehicle) and vehicle.name != leader,
        )
        for vehicle in setup.guarded
    }
    guard_settings = setup.case.guarding
    settings = GuardSettings(
        keep_m=guard_settings.keep_m,
        latency_s=guard_settings.latency_s,
        braking_m_s2=guard_settings.braking_m_s2,
    )
    if setup.clock == "virtual":
        return _guard_in_process(setup, guarded, settings, record, tracks)
    guard_config = GuardConfig(
        run=setup.order.plan.name,
        folder=str(setup.order.folder.absolute()),
        campaign=str((setup.order.campaign or setup.order.folder).absolute()),
        epoch_s=time.time() - asyncio.get_running_loop().time(),
        vehicles={
            flown.name: GuardedVehicleConfig(
                vehicle=guarded[flown.name],
                link=_address(flown, prepared),
                patient=flown.launch is not None,
                gcs=setup.case.gcs.get(flown.name, ""),
                spares=tuple(map(str, flown.spares)),
                conditions=link_conditions_of(setup, flown),
            )
            for flown in setup.guarded
        },
        settings=replace(settings, orchestrator_silent_s=HANGING_S * setup.pace),
        pace=pace,
    )
    fed = [flown.name for flown in setup.guarded if flown.embedded]
    guard = RemoteGuard(guard_config=guard_config, record=record, fed=fed)
    backend = SubprocessBackend(setup, guard, prepared)
    return guard, backend, {name: guard.link(name) for name in guarded}


def _lands_alone(setup: RunSetup, vehicle: FlownSetup) -> bool:
    return vehicle.name == setup.companion or vehicle in setup.actors


def _is_abandoned_when_lost(setup: RunSetup, vehicle: FlownSetup) -> bool:
    """Return whether the guard abandons a lost vehicle; an attached actor may still be flying.

    The twin is always simulated, also an attached one.
    """
    return vehicle.name == setup.companion or (vehicle in setup.actors and not vehicle.attached)


def _pace_of(setup: RunSetup) -> PaceSetup | None:
    """Return the settings of the scaled clock; None under another.

    A simulator leads it if one is launched.
    """
    if setup.clock != "scaled":
        return None
    launched = tuple(flown.name for flown in setup.guarded if flown.launch is not None)
    return PaceSetup(
        nominal=setup.pace,
        leader=next(iter(launched), None),
        launched=launched,
        followers=tuple(flown.name for flown in setup.guarded if flown.embedded),
    )


def _address(vehicle: FlownSetup, prepared: Mapping[str, ReservedLaunch]) -> str:
    """Return the guard's link address of a vehicle; empty for a port that the guard chooses."""
    if vehicle.name in prepared:
        return str(prepared[vehicle.name].link)
    return "" if vehicle.attached is None else str(vehicle.attached)


def link_conditions_of(setup: RunSetup, vehicle: FlownSetup) -> LinkConditions:
    """Return the link conditions between guard and vehicle, by the run's seed."""
    seed = vehicle_seed(setup.seed, vehicle.name), _LINK_SEED
    observers = setup.case.observers.values()
    layers = (observer.link_layer(vehicle.name, seed) for observer in observers)
    air = tuple(layer for layer in layers if layer is not None)
    return LinkConditions(air=air, signing=vehicle.signing)


def _guard_in_process(
    setup: RunSetup,
    guarded: Mapping[str, GuardedVehicle],
    settings: GuardSettings,
    record: Record,
    tracks: Mapping[str, ObjectTrack],
) -> tuple[Guard, VehicleBackend, Mapping[str, Link]]:
    """Return a local guard, its in-process backend, and the links by vehicle."""
    backend = InProcessBackend(setup, tracks)
    inner: dict[str, GuardLinks] = {}
    outer: dict[str, Link] = {}
    for vehicle in setup.guarded:
        near, outer[vehicle.name] = memory_pair(name=f"{vehicle.name} guard")
        there = link_under_conditions(
            [backend.link(vehicle)], link_conditions_of(setup, vehicle), utc_s=VIRTUAL_EPOCH_S
        )
        inner[vehicle.name] = GuardLinks(
            vehicle=there.link, orchestrator=near, impaired=there.impaired
        )
    guard = LocalGuard(vehicles=guarded, links=inner, settings=settings, record=record)
    return guard, backend, outer
