"""Whether the vehicles of a campaign can fly, and those of a pair be told apart; pure."""

from collections.abc import Iterator, Sequence

from campaigns.schema import Mode
from campaigns.setup.case_files import CaseFiles
from campaigns.setup.case_setup import FLIES, Setup, VehicleSetup
from vehicles.launch.px4 import Px4Launch
from vehicles.mavsdk.ids import OWN_SYSTEM
from worlds.files.documents import Problem

_FELT = frozenset({"imu", "microphone", "pose"})
"""Types of sensors that tell of a vehicle's own motion, not of a place."""


def vehicle_problems(files: CaseFiles, setup: Setup, mode: Mode) -> Iterator[Problem]:
    """Yield the problems of the vehicles: unequal simulation paces, a pair of one vehicle."""
    flown = [setup.vehicles[name] for name in FLIES[mode]]
    yield from _pace_problems(files, setup, flown)
    for vehicle in setup.vehicles.values():
        yield from _spare_problems(files, vehicle)
        if vehicle.driver == "mavsdk" and vehicle.system_id == OWN_SYSTEM:
            said = (
                f"the driver mavsdk uses system id {OWN_SYSTEM} itself; give the vehicle "
                "another one"
            )
            yield files.campaign.problem(("vehicles", vehicle.name, "system_id"), said)
    yield from _actor_problems(files, setup)
    if mode == "wil":
        yield from _pair_problems(files, setup)


def _actor_problems(files: CaseFiles, setup: Setup) -> Iterator[Problem]:
    """Yield cameras of a simulator that moves a flown object by its world file."""
    if not setup.actors:
        return
    actor = next(iter(setup.actors))
    for vehicle in setup.vehicles.values():
        for camera in vehicle.cameras:
            if camera.source is not None and camera.source.asked:
                said = (
                    f"a simulator is not told where the actor '{actor}' flies; leave out `source`, "
                    "or the actor"
                )
                path = ("vehicles", vehicle.name, "sensors", camera.name, "source")
                yield files.campaign.problem(path, said)


def _pace_problems(
    files: CaseFiles, setup: Setup, flown: Sequence[VehicleSetup]
) -> Iterator[Problem]:
    """Yield vehicles of a pair that are simulated at different paces (embedded ones adapt)."""
    paces = {one.name: pace for one in flown if (pace := one.launch_pace) is not None}
    if not paces:
        return
    asked = next(iter(paces.values()))
    if setup.speed not in {None, asked}:
        said = f"a launched simulation flies at {asked:g}, as its link says; leave it out"
        yield files.campaign.problem(("clock", "speed"), said)
    for one in flown:
        path = ("vehicles", one.name, "link", _pace_key(one))
        if one.name in paces and paces[one.name] != asked:
            said = f"the other vehicle flies at {asked:g} times real time; both need the same"
            yield files.campaign.problem(path, said)
    attached = next((one.name for one in flown if one.attached is not None), None)
    if attached is not None and asked != 1.0:
        launched = next(one for one in flown if one.launch is not None)
        path = ("vehicles", launched.name, "link", _pace_key(launched))
        said = (
            f"{attached} is attached and runs in real time: it cannot follow; remove "
            f"'{_pace_key(launched)}'"
        )
        yield files.campaign.problem(path, said)


def _pace_key(vehicle: VehicleSetup) -> str:
    """Return the campaign key that sets a launched vehicle's pace: PX4 speed, ArduPilot speedup."""
    return "speed" if isinstance(vehicle.launch, Px4Launch) else "speedup"


def _pair_problems(files: CaseFiles, setup: Setup) -> Iterator[Problem]:
    """Yield real and twin vehicles that share a system id or an address."""
    real, twin = setup.vehicles["real"], setup.vehicles["twin"]
    if twin.coupling == "placed":
        yield from _placed_problems(files, twin)
        return
    if twin.coupling == "shadow" and setup.under_test.program is not None:
        said = (
            "shadow needs an autonomy of `use`: the setpoints of a program are in the real "
            "vehicle's own frame; write follow or free"
        )
        yield files.campaign.problem(("vehicles", "twin", "coupling"), said)
    if real.system_id == twin.system_id:
        said = f"both vehicles have system id {real.system_id}; give them different ones"
        path = ("vehicles", "twin", "system_id")
        yield files.campaign.problem(path, said)
    shared = next((one for one in twin.addresses if one in real.addresses), None)
    if shared is not None:
        said = f"both vehicles are on {shared}; each needs its own link"
        key = "link" if shared == twin.attached else "spare_links"
        yield files.campaign.problem(("vehicles", "twin", key), said)


def _placed_problems(files: CaseFiles, twin: VehicleSetup) -> Iterator[Problem]:
    """Yield sensors that feel a flight, of a twin that nothing flies."""
    for sensor in twin.sensors:
        if sensor.kind in _FELT:
            said = f"nothing flies a placed twin, and {sensor.kind} is of a flight; write follow"
            yield files.campaign.problem(("vehicles", "twin", "sensors", sensor.name), said)


def _spare_problems(files: CaseFiles, vehicle: VehicleSetup) -> Iterator[Problem]:
    """Yield a vehicle's spare links that are named twice."""
    for at, spare in enumerate(vehicle.spares):
        if spare == vehicle.attached or spare in vehicle.spares[:at]:
            path = ("vehicles", vehicle.name, "spare_links", at)
            yield files.campaign.problem(path, f"{spare} is named twice")
