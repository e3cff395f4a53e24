"""Checks of a campaign's vehicles: simulation speeds, system ids, links, sensors of twins; pure."""

from collections.abc import Iterable, Iterator, Sequence

from wil_campaign.campaigns.schema import Mode
from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.campaigns.setup.case_setup import FLIES, Case, VehicleSetup
from wil_campaign.campaigns.setup.vehicle_setups import FlownSetup
from wil_campaign.campaigns.values.sensor_setups import sensor_options_of
from wil_campaign.foundation.files.documents import Problem
from wil_campaign.hooks import drivers
from wil_campaign.installed_plugins import plugin_additions
from wil_campaign.vehicles.sensors.sensor_spec import SensorOptions


def vehicle_problems(files: CaseFiles, case: Case, mode: Mode) -> Iterator[Problem]:
    """Yield the problems of the vehicles: unequal simulation paces, a pair of one vehicle."""
    actors = case.actors_in(mode)
    flown = [*(case.vehicles[name] for name in FLIES[mode]), *actors]
    yield from _pace_problems(files, case, flown)
    for index, actor in enumerate(actors):
        yield from _shared_links(files, actor, flown[: len(flown) - len(actors) + index])
    for vehicle in case.vehicles.values():
        yield from _spare_problems(files, vehicle)
        driver = plugin_additions(drivers).get(vehicle.driver)
        if driver is not None and vehicle.system_id == driver.system_id:
            message = (
                f"the driver {driver.name} uses system id {driver.system_id} itself; give the "
                "vehicle another one"
            )
            yield files.campaign.problem(("vehicles", vehicle.name, "system_id"), message)
    if mode == "wil":
        yield from _pair_problems(files, case)


def _pace_problems(files: CaseFiles, case: Case, flown: Sequence[FlownSetup]) -> Iterator[Problem]:
    """Yield vehicles of a pair that are simulated at different paces (embedded ones adapt)."""
    first = next((one.launch.pace for one in flown if one.launch is not None), None)
    if first is None:
        return
    if case.speed not in {None, first}:
        message = f"the link of a launched simulation sets the speed to {first:g}; remove this key"
        yield files.campaign.problem(("clock", "speed"), message)
    for one in flown:
        if one.launch is not None and one.launch.pace != first:
            message = f"the other vehicle flies at {first:g} times real time; both need the same"
            path = (*one.path, "link", one.launch.pace_key)
            yield files.campaign.problem(path, message)
    attached = next((one.name for one in flown if one.attached is not None), None)
    if attached is not None and first != 1.0:
        where, key = next(
            (one.path, one.launch.pace_key) for one in flown if one.launch is not None
        )
        message = f"{attached} is attached and runs in real time only; remove '{key}'"
        yield files.campaign.problem((*where, "link", key), message)


def _pair_problems(files: CaseFiles, case: Case) -> Iterator[Problem]:
    """Yield real and twin vehicles that share a system id or an address."""
    real, twin = case.vehicles["real"], case.vehicles["twin"]
    if twin.coupling == "placed":
        yield from _placed_problems(files, case, twin)
        return
    foreign = case.under_test.foreign
    if twin.coupling == "shadow" and foreign is not None and case.under_test.has_runner:
        message = (
            f"shadow needs an autonomy of `use`: the setpoints of a {foreign.kind} are in the real "
            "vehicle's own frame; write follow or free"
        )
        yield files.campaign.problem(("vehicles", "twin", "coupling"), message)
    if real.system_id == twin.system_id:
        message = f"both vehicles have system id {real.system_id}; give them different ones"
        path = ("vehicles", "twin", "system_id")
        yield files.campaign.problem(path, message)
    yield from _shared_links(files, twin, (real,))


def _shared_links(
    files: CaseFiles, vehicle: FlownSetup, others: Iterable[FlownSetup]
) -> Iterator[Problem]:
    """Yield an address of a vehicle that another vehicle has as well."""
    for other in others:
        shared = next(
            (address for address in vehicle.addresses if address in other.addresses), None
        )
        if shared is not None:
            message = (
                f"{other.name} and {vehicle.name} are both on {shared}; each needs its own link"
            )
            key = "link" if shared == vehicle.attached else "spare_links"
            yield files.campaign.problem((*vehicle.path, key), message)


def _placed_problems(files: CaseFiles, case: Case, twin: VehicleSetup) -> Iterator[Problem]:
    """Yield what a placed twin does not have: sensors that measure a flight, a pose source."""
    for sensor in twin.sensors:
        if (options := sensor_options_of(sensor, SensorOptions)) and options.embedded_only:
            message = f"a placed twin does not fly: it has no {sensor.kind}; write coupling: follow"
            yield files.campaign.problem(("vehicles", "twin", "sensors", sensor.name), message)
    for fault in case.faults:
        if fault.vehicle == "twin" and fault.sensor is None:
            message = "a placed twin does not fly: its pose is the real vehicle's; remove this"
            yield files.campaign.problem(("faults", "twin", "pose_source"), message, key=True)


def _spare_problems(files: CaseFiles, vehicle: VehicleSetup) -> Iterator[Problem]:
    """Yield a vehicle's spare links that are named twice."""
    for at, spare in enumerate(vehicle.spares):
        if spare == vehicle.attached or spare in vehicle.spares[:at]:
            path = ("vehicles", vehicle.name, "spare_links", at)
            yield files.campaign.problem(path, f"{spare} is named twice")
