"""Opens the pair: vehicles, links, guard and drivers, in the order in which they may be closed."""

from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass

from campaigns.setup import VehicleSetup
from orchestrator.run.setup import RunSetup
from orchestrator.run.station import Station
from safety.guard.events import GuardedVehicle
from safety.guard.shell import GuardLinks, GuardShell, Record
from vehicles.autopilots.base import Target
from vehicles.autopilots.registry import autopilot_named
from vehicles.driver import Driver
from vehicles.embedded.config import EmbeddedConfig, Surroundings
from vehicles.embedded.vehicle import EmbeddedVehicle
from vehicles.links.memory import memory_pair
from worlds.clearance import ClearanceProbe
from worlds.frames import Pose
from worlds.parts import BoxShape

SYSTEM_IDS = {"real": 1, "twin": 2}
_LINK_LATENCY_S = 0.003
"""Each way, as measured between processes on one machine's loopback, rounded up."""
_TRUTH_HZ = 125.0
_CLOCK_DRIFT = 2e-4
"""The worst crystal that a vehicle's clock has, ten times over; only SITL drifts by more."""

BODY = BoxShape((0.15, 0.15, 0.05))
"""The embedded airframe: 0.3 m wide over the propellers (the paper's vehicle), 0.1 m high."""


@dataclass(frozen=True, slots=True)
class Pair:
    """What flies: one station in modes sim and real, two in wil."""

    stations: tuple[Station, ...]
    vehicles: Mapping[str, EmbeddedVehicle]
    guard: GuardShell

    def station(self, name: str) -> Station | None:
        """Return the station of a vehicle, None when it does not fly in this mode."""
        return next((one for one in self.stations if one.name == name), None)


class PhysicalSurroundings:
    """The things of a scene as a body feels them; the ground it stands on is no contact."""

    def __init__(self, *, probe: ClearanceProbe, events: Mapping[str, float]) -> None:
        self._probe = probe
        self._events = events

    def contact(self, pose_0: Pose, t_0: float, pose_1: Pose, t_1: float) -> str | None:
        """Return the first thing touched on the way between two poses (world frame), or None."""
        touched = [
            found
            for found in self._probe.sweep(pose_0, t_0, pose_1, t_1, self._events)
            if found.clearance_m <= 0.0 and not found.is_floor
        ]
        first = min(touched, key=lambda found: found.at_s, default=None)
        return None if first is None else f"{first.object_name}.{first.part_name}".rstrip(".")


@asynccontextmanager
async def open_pair(
    setup: RunSetup, *, events: Mapping[str, float], record: Record
) -> AsyncIterator[Pair]:
    """Start the vehicles of a run and connect to them through the guard.

    Closing stops the vehicles, wherever they are: land before that. Raises LinkError.
    """
    async with AsyncExitStack() as stack:
        embedded: dict[str, EmbeddedVehicle] = {}
        links: dict[str, GuardLinks] = {}
        guarded: dict[str, GuardedVehicle] = {}
        stations: list[Station] = []
        for vehicle in setup.vehicles:
            far, near = memory_pair(latency_s=_LINK_LATENCY_S, name=vehicle.name)
            inner, outer = memory_pair(name=f"{vehicle.name} guard")
            embedded[vehicle.name] = EmbeddedVehicle(
                config=_config(setup, vehicle),
                link=far,
                seed=vehicle_seed(setup.seed, vehicle.name),
                surroundings=_surroundings(setup, vehicle, events),
            )
            links[vehicle.name] = GuardLinks(vehicle=near, orchestrator=inner)
            guarded[vehicle.name] = GuardedVehicle(
                autopilot=autopilot_named(vehicle.autopilot),
                target=Target(SYSTEM_IDS[vehicle.name]),
                fence=setup.campaign.fence,
            )
            driver = Driver(
                name=vehicle.name,
                link=outer,
                autopilot=vehicle.autopilot,
                start=vehicle.start,
                max_clock_drift=_CLOCK_DRIFT,
            )
            stations.append(
                Station(
                    name=vehicle.name,
                    driver=driver,
                    start=vehicle.start,
                    pose_source=vehicle.pose_source,
                )
            )
        guard = GuardShell(vehicles=guarded, links=links, record=record)
        for flown in embedded.values():
            await stack.enter_async_context(flown)
        await stack.enter_async_context(guard)
        for station in stations:
            await stack.enter_async_context(station.driver)
            _wire(station, embedded[station.name], guard)
        yield Pair(tuple(stations), embedded, guard)


def vehicle_seed(seed: int, name: str) -> int:
    """Return the seed of one vehicle: real and twin must not share their noise."""
    return seed * 2 + (1 if name == "twin" else 0)


def _wire(station: Station, vehicle: EmbeddedVehicle, guard: GuardShell) -> None:
    station.driver.on_estimate(station.take_estimate)
    vehicle.on_mocap(station.take_mocap)
    vehicle.on_truth(station.take_truth, _TRUTH_HZ)
    station.on_pose(guard.position)


def _config(setup: RunSetup, vehicle: VehicleSetup) -> EmbeddedConfig:
    frame = setup.campaign.world.frame
    return EmbeddedConfig(
        autopilot=vehicle.autopilot,
        profile=setup.profiles[vehicle.name],
        source=vehicle.name,
        system_id=SYSTEM_IDS[vehicle.name],
        start=vehicle.start,
        latitude_deg=frame.latitude_deg,
        longitude_deg=frame.longitude_deg,
        altitude_m=frame.altitude_m,
        parameters=vehicle.params,
    )


def _surroundings(
    setup: RunSetup, vehicle: VehicleSetup, events: Mapping[str, float]
) -> Surroundings | None:
    """Return what the vehicle can physically hit: only the real one can break anything."""
    if vehicle.name != "real":
        return None
    return PhysicalSurroundings(probe=ClearanceProbe(setup.real_scene, BODY), events=events)
