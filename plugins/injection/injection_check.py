"""Checks that autopilots use injected messages: before arming, and in flight."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from wil_campaign.campaigns.setup.case_setup import VehicleSetup
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.plugins.injection.injection_setups import Injected, InjectionSetup
from wil_campaign.plugins.injection.injection_support import (
    flown_mode,
    injection_faults,
    matters_in_flight,
    parameters_to_read,
)
from wil_campaign.plugins.injection.rules import Ignored, InjectionKind
from wil_campaign.vehicles.autopilots.autopilot import AutopilotName
from wil_campaign.vehicles.errors import ParameterError, VehicleError
from wil_campaign.worlds.frames import Pose, rotate

_DOWN = 0.7
"""A rangefinder that looks down by this share or more measures height, else proximity."""


class UnsupportedInjectionError(VehicleError):
    """An autopilot would ignore an injection; says which, why, and the remedy."""


@dataclass(frozen=True, slots=True)
class InjectionProof:
    """The check of one injection into a vehicle: the parameters that make it use the message."""

    context: VehicleContext
    autopilot: AutopilotName
    thing: InjectionKind
    parameters: Mapping[str, float]

    def broken(self) -> tuple[Ignored, ...]:
        """Return why injections are ignored now, in the flown mode and setpoints."""
        if not matters_in_flight(self.thing):
            return ()
        mode, setpoints = self.context.driver.state.mode_name, self.context.steered_by
        return injection_faults(
            self.autopilot, self.thing, self.parameters, mode, setpoints=setpoints or "velocity"
        )

    def text_of(self, reasons: Iterable[Ignored]) -> str:
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
            if context.name not in injection.to:
                continue
            thing = message_name(injection.thing, _mount(vehicle, injection.sensor))
            proof = await _read_parameters(context, vehicle.autopilot, thing)
            reasons = injection_faults(
                vehicle.autopilot,
                thing,
                proof.parameters,
                flown_mode(vehicle.autopilot, thing),
                unbooted=unbooted.get(context.name, frozenset()),
            )
            proofs.append(proof)
            faults += [proof.text_of(reasons)] if reasons else []
    if faults:
        raise UnsupportedInjectionError("injection would be ignored: " + "; ".join(faults))
    return tuple(proofs)


def message_name(injected: Injected, mount: Pose | None) -> InjectionKind:
    """Return the injected message's name in the rules; a rangefinder's mount decides."""
    if injected == "distance_sensor" and mount is not None:
        down = rotate(mount.q_wxyz, (1.0, 0.0, 0.0))[2]
        return "distance_sensor" if down >= _DOWN else "distance_sensor_sideways"
    return injected


async def _read_parameters(
    context: VehicleContext, autopilot: AutopilotName, thing: InjectionKind
) -> InjectionProof:
    parameters: dict[str, float] = {}
    for name in parameters_to_read(autopilot, thing):
        try:
            parameters[name] = await context.driver.parameters.get(name)
        except ParameterError:
            continue  # the rule reports the missing parameter
    return InjectionProof(context, autopilot, thing, parameters)


def _mount(vehicle: VehicleSetup, sensor: str | None) -> Pose | None:
    """Return the mount of an injected sensor; None without one."""
    sensors = (one for one in vehicle.sensors if one.name == sensor)
    mount = getattr(next(sensors, None), "mount", None)
    return mount if isinstance(mount, Pose) else None
