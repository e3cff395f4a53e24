"""Injections of one run into its autopilots: checked before arming, and watched in flight.

Checks that autopilots use injected messages: before arming, and in flight.
"""

import asyncio
from collections.abc import Coroutine, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from wil_campaign.campaigns.setup.case_setup import VehicleSetup
from wil_campaign.orchestrator.run_results.result_parts import ExternalResult
from wil_campaign.orchestrator.state.observer import Observer
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.plugins.injection.injection_setups import (
    InjectionSetup,
    InjectionSetups,
    injected_message_name,
    mount_of,
    receives_no_obstacles,
)
from wil_campaign.plugins.injection.injection_support import (
    injection_faults,
    injection_mode,
    matters_in_flight,
    parameters_to_read,
)
from wil_campaign.plugins.injection.injector import Injector, ScenePoses
from wil_campaign.plugins.injection.rules import IgnoredInjection, InjectionKind
from wil_campaign.vehicles.errors import ParameterError, VehicleError
from wil_campaign.vehicles.readings import Reading


class UnsupportedInjectionError(VehicleError):
    """An autopilot would ignore an injection; says which, why, and the remedy."""


@dataclass(frozen=True, slots=True)
class InjectionProof:
    """The check of one injection into a vehicle: the parameters that make it use the message."""

    context: VehicleContext
    autopilot: str
    thing: InjectionKind
    parameters: Mapping[str, float]

    def broken(self) -> tuple[IgnoredInjection, ...]:
        """Return why injections are ignored now, in the flown mode and setpoints."""
        if not matters_in_flight(self.thing):
            return ()
        mode, setpoints = self.context.driver.state.mode_name, self.context.steered_by
        return injection_faults(
            self.autopilot, self.thing, self.parameters, mode, setpoints=setpoints or "velocity"
        )

    def text_of(self, reasons: Iterable[IgnoredInjection]) -> str:
        """Return reasons of ignored injections in words, with the vehicle."""
        return "; ".join(f"{self.context.name}, {self.thing}: {reason}" for reason in reasons)


async def prove_injection(
    contexts: Iterable[VehicleContext],
    vehicles: Mapping[str, VehicleSetup],
    injections: Iterable[InjectionSetup],
    *,
    unbooted: Mapping[str, frozenset[str]],
) -> tuple[InjectionProof, ...]:
    """Check injections by the autopilots' parameters. Raises UnsupportedInjectionError.

    Only parameters that the vehicle itself reports count: it may not have accepted others.
    unbooted: of each vehicle the parameters that were changed since it booted.
    """
    requested = tuple(injections)
    proofs: list[InjectionProof] = []
    faults: list[str] = []
    for context in contexts:
        vehicle = vehicles[context.name]
        for injection in requested:
            if context.name not in injection.to or injection.only_stands_by:
                continue
            thing = injected_message_name(injection.thing, mount_of(vehicle, injection.sensor))
            proof = await _read_parameters(context, vehicle.autopilot, thing)
            reasons = injection_faults(
                vehicle.autopilot,
                thing,
                proof.parameters,
                injection_mode(vehicle.autopilot, thing),
                unbooted=unbooted.get(context.name, frozenset()),
            )
            proofs.append(proof)
            faults += [proof.text_of(reasons)] if reasons else []
    if faults:
        raise UnsupportedInjectionError("injection would be ignored: " + "; ".join(faults))
    return tuple(proofs)


async def _read_parameters(
    context: VehicleContext, autopilot: str, thing: InjectionKind
) -> InjectionProof:
    parameters: dict[str, float] = {}
    for name in parameters_to_read(autopilot, thing):
        try:
            parameters[name] = await context.driver.parameters.get(name)
        except ParameterError:
            continue  # the rule reports the missing parameter
    return InjectionProof(context, autopilot, thing, parameters)


_WATCH_S = 0.1


class Injections(Observer):
    """All injections of one run. events: the world's, by time."""

    def __init__(
        self,
        *,
        setup: RunSetup,
        injections: Iterable[InjectionSetup],
        events: Mapping[str, float],
    ) -> None:
        self._setup = setup
        self._injections = tuple(injections)
        self._events = events
        self._contexts: tuple[VehicleContext, ...] = ()
        self._injectors: dict[str, Injector] = {}
        self._proofs: tuple[InjectionProof, ...] = ()

    def attach(self, contexts: Iterable[VehicleContext]) -> None:
        """Attach the vehicles whose autopilots receive injections."""
        setup, self._contexts = self._setup, tuple(contexts)
        scene_poses = ScenePoses(
            setup.virtual_scene if setup.mode != "real" else setup.real_scene,
            setup.case.world.frame,
            self._events,
        )
        for context in self._contexts:
            vehicle = setup.vehicle(context.name)
            mounts = ((sensor.name, mount_of(vehicle, sensor.name)) for sensor in vehicle.sensors)
            injector = Injector(
                context=context,
                autopilot=vehicle.autopilot,
                injections=self._injections,
                scene_poses=scene_poses,
                is_attached=vehicle.attached is not None,
                mounts={name: mount for name, mount in mounts if mount is not None},
            )
            if injector.injections:
                self._injectors[context.name] = injector
                context.on_mocap(injector.pose)

    async def before_arming(self, unbooted: Mapping[str, frozenset[str]], /) -> str:
        """Check that injections are used. Raises UnsupportedInjectionError."""
        if not self._injectors:
            return ""
        vehicles = {str(vehicle.name): vehicle for vehicle in self._setup.vehicles}
        self._proofs = await prove_injection(
            self._contexts, vehicles, self._injections, unbooted=unbooted
        )
        fed = dict.fromkeys(proof.context.name for proof in self._proofs)
        return f"injections into {' and '.join(fed)} are used" if fed else ""

    def tasks(self, run_state: RunState, /) -> Iterator[tuple[str, Coroutine[Any, Any, None]]]:
        """Yield what injects places of objects, and what watches that the autopilots act on it."""
        for name, injector in self._injectors.items():
            yield f"standing by for {name}", injector.stand_by(run_state)
            yield f"injection into {name}", injector.run()
        if self._injectors:
            yield "injection watch", self._watch(run_state)

    def perceived(self, reading: Reading, by: tuple[str, ...]) -> None:
        """Inject a perceived reading into the autopilots of its receivers."""
        for name in by:
            if name in self._injectors:
                self._injectors[name].perceived(reading.sensor, reading)

    @property
    def result(self) -> ExternalResult:
        """Return the counts of injected messages."""
        return ExternalResult(
            injected=tuple(r for injector in self._injectors.values() for r in injector.results)
        )

    async def _watch(self, run_state: RunState) -> None:
        """End the flight as INVALID when an autopilot ignores its injections.

        Only after two checks in a row: a mode change may be in progress.
        """
        before = ""
        while True:
            await asyncio.sleep(_WATCH_S)
            problems = ""
            if run_state.stage == "goal" and not run_state.decisive:
                broken = ((proof, proof.broken()) for proof in self._proofs)
                problems = "; ".join(proof.text_of(reasons) for proof, reasons in broken if reasons)
            if problems and problems == before:
                text = f"injection was ignored: {problems}"
                run_state.decide("INVALID", text, source="injection")
                return
            before = problems


def observe(setup: RunSetup, given: InjectionSetups, events: Mapping[str, float]) -> Injections:
    """Return the injections of a run."""
    injections = tuple(_beside_follower(setup, given.injections))
    return Injections(setup=setup, injections=injections, events=events)


def _beside_follower(
    setup: RunSetup, injections: Iterable[InjectionSetup]
) -> Iterator[InjectionSetup]:
    """Yield injections, of which those of obstacles only stand by for a twin that follows."""
    companion = setup.companion
    follower = setup.vehicle(companion) if companion is not None else None
    for one in injections:
        if follower is None or not receives_no_obstacles(follower, one):
            yield one
            continue
        if others := tuple(name for name in one.to if name != follower.name):
            yield replace(one, to=others)
        yield replace(one, to=(follower.name,), only_stands_by=True)
