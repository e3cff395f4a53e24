"""Setups of a campaign's signal faults; faults of unknown sensors are problems."""

from collections.abc import Iterator, Mapping

from wil_campaign.campaigns.schema.faults import (
    FaultsPart,
    MomentPart,
    SignalFaultPart,
    VehicleFaultsPart,
)
from wil_campaign.campaigns.schema.vehicles import VehicleName
from wil_campaign.campaigns.setup.vehicle_setups import VehicleSetup
from wil_campaign.campaigns.values.signal_faults import SignalFault
from wil_campaign.foundation.files.documents import Document, Path, Problem, closest_word
from wil_campaign.vehicles.faults import FaultKind


def fault_setups(
    file: Document,
    part: FaultsPart,
    vehicles: Mapping[VehicleName, VehicleSetup],
    problems: list[Problem],
) -> tuple[SignalFault, ...]:
    """Return the faults; those of an unknown vehicle or sensor are collected as problems."""
    given: dict[VehicleName, VehicleFaultsPart | None] = {"real": part.real, "twin": part.twin}
    found: list[SignalFault] = []
    for name, faults in given.items():
        if faults is None:
            continue
        problems += _unknown_signals(file, name, faults, vehicles.get(name))
        if faults.pose_source is not None:
            found.append(_fault_of(name, None, faults.pose_source))
        found += [
            _fault_of(name, sensor, signal_fault) for sensor, signal_fault in faults.sensors.items()
        ]
    return tuple(found)


def _unknown_signals(
    file: Document, name: VehicleName, faults: VehicleFaultsPart, vehicle: VehicleSetup | None
) -> Iterator[Problem]:
    path: Path = ("faults", name)
    if vehicle is None:
        yield file.problem(path, f"there is no vehicle '{name}'", key=True)
        return
    known = [sensor.name for sensor in vehicle.sensors]
    for sensor in faults.sensors:
        if sensor not in known:
            message = f"vehicle '{name}' has no sensor '{sensor}'"
            at = (*path, "sensors", sensor)
            yield file.problem(at, message, closest_word(sensor, known), key=True)


def _fault_of(vehicle: VehicleName, sensor: str | None, part: SignalFaultPart) -> SignalFault:
    moments: dict[FaultKind, MomentPart | None] = {"stop": part.stop, "freeze": part.freeze}
    kind, moment = next((kind, one) for kind, one in moments.items() if one is not None)
    return SignalFault(
        vehicle=vehicle,
        sensor=sensor,
        kind=kind,
        stage=moment.on,
        after_s=moment.after_s,
        for_s=moment.for_s,
    )
