"""Whether the vehicles of a campaign can fly, and those of a pair be told apart; pure."""

from collections.abc import Iterator

from campaigns.files import CaseFiles
from campaigns.schema import Mode
from campaigns.setup import Setup, VehicleSetup
from vehicles.launch.ardupilot import ArduPilotLaunch
from vehicles.launch.px4 import Px4Launch
from worlds.documents import Problem


def vehicle_problems(files: CaseFiles, setup: Setup, mode: Mode) -> Iterator[Problem]:
    """Yield what cannot fly: a simulation at another pace, a pair that is one vehicle."""
    for vehicle in setup.vehicles.values():
        yield from _pace_problems(files, vehicle)
        yield from _spare_problems(files, vehicle)
    if mode == "wil":
        yield from _pair_problems(files, setup)


def _pace_problems(files: CaseFiles, vehicle: VehicleSetup) -> Iterator[Problem]:
    match vehicle.launch:
        case ArduPilotLaunch(speedup=pace):
            key = "speedup"
        case Px4Launch(speed=pace):
            key = "speed"
        case _:
            return
    if pace != 1.0:
        said = f"a campaign flies simulations in real time; leave '{key}' out"
        yield files.campaign.problem(("vehicles", vehicle.name, "link", key), said)


def _pair_problems(files: CaseFiles, setup: Setup) -> Iterator[Problem]:
    real, twin = setup.vehicles["real"], setup.vehicles["twin"]
    if real.system_id == twin.system_id:
        said = f"both vehicles have system id {real.system_id}; give them different ones"
        path = ("vehicles", "twin", "system_id")
        yield files.campaign.problem(path, said)
    shared = next((one for one in twin.addresses if one in real.addresses), None)
    if shared is not None:
        said = f"both vehicles are on {shared}; each needs a link of its own"
        key = "link" if shared == twin.attached else "spare_links"
        yield files.campaign.problem(("vehicles", "twin", key), said)


def _spare_problems(files: CaseFiles, vehicle: VehicleSetup) -> Iterator[Problem]:
    for at, spare in enumerate(vehicle.spares):
        if spare == vehicle.attached or spare in vehicle.spares[:at]:
            path = ("vehicles", vehicle.name, "spare_links", at)
            yield files.campaign.problem(path, f"{spare} is named twice")
