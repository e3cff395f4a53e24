"""What one run needs, resolved and checked: the campaign of one case as frozen values."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

from campaigns.schema import Mode, PreflightPart, RecordPart, VehicleName
from campaigns.setup.actor_setups import ActorSetup
from campaigns.setup.autonomy_under_test import UnderTest
from campaigns.setup.link_setups import LinkSetup
from campaigns.setup.vehicle_setups import FlownSetup, VehicleSetup
from campaigns.values.external_setups import ExternalSetup
from campaigns.values.sensor_setups import CameraSetup, SensorSetup
from campaigns.values.signal_faults import SignalFault
from recipes.model.recipe import Recipe
from safety.evaluation.judge import OracleUse
from safety.fence.geofence import Fence
from safety.guard.core.events import GuardSettings
from safety.guard.core.setpoint_limits import SetpointLimits
from vehicles.coupling import LIMITS_M
from worlds.files.documents import Path
from worlds.frames import Vec3
from worlds.world_file.world import World

_USUAL = GuardSettings()

__all__ = [
    "CameraSetup",
    "GoalSetup",
    "GuardingSetup",
    "LinkSetup",
    "SensorSetup",
    "Setup",
    "SyncSetup",
    "VehicleSetup",
]


FLIES: Mapping[Mode, tuple[VehicleName, ...]] = {
    "sim": ("twin",),
    "wil": ("real", "twin"),
    "real": ("real",),
}
"""The vehicles of each mode; the first is the subject, which is judged. All of them fly, except a
placed twin (`Setup.flying`)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SyncSetup:
    """The synchronisation limits of a case; seconds of the run clock, metres."""

    identify_timeout_s: float
    ready_timeout_s: float
    takeoff_timeout_s: float
    takeoff_tolerance_m: float
    goal_timeout_s: float
    landing_timeout_s: float
    max_command_skew_s: float
    max_takeoff_skew_s: float
    max_t0_skew_s: float
    max_twin_distance_m: float = LIMITS_M["follow"]
    takeoff: Literal["liftoff", "command"] = "liftoff"


@dataclass(frozen=True, slots=True, kw_only=True)
class GoalSetup:
    """The goal of a case. altitude_m: over the world's origin. gates: object names in order."""

    altitude_m: float
    gates: tuple[str, ...] = ()
    position_ned_m: Vec3 | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardingSetup:
    """The guard's distances of a case; see `GuardSettings`."""

    keep_m: float = _USUAL.keep_m
    latency_s: float = _USUAL.latency_s
    braking_m_s2: float = _USUAL.braking_m_s2


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """The complete setup of one case.

    actors: vehicles that fly as objects of the world, by the object's name.
    recipe: None where no mode mixes. fences: of the vehicles and actors that have one; guarding:
    how the guard keeps them. limits: of setpoints; None for none. links: those with impairments.
    faults: injected into signals.
    collision_always: whether contacts are judged even without the oracle `collision`.
    unsigned_commands: whether operators command by MQTT without a signature.
    gcs: link strings of ground station ports. speed: of the scaled clock, where no launched
    simulation has one of its own; None where the campaign says none.
    """

    vehicles: Mapping[VehicleName, VehicleSetup]
    world: World
    recipe: Recipe | None
    under_test: UnderTest
    goal: GoalSetup
    sync: SyncSetup
    fences: Mapping[str, Fence]
    oracles: tuple[OracleUse, ...]
    actors: Mapping[str, ActorSetup] = field(default_factory=dict)
    links: Mapping[str, LinkSetup] = field(default_factory=dict)
    faults: tuple[SignalFault, ...] = ()
    preflight: PreflightPart = field(default_factory=PreflightPart)
    record: RecordPart = field(default_factory=RecordPart)
    guarding: GuardingSetup = GuardingSetup()
    outside: ExternalSetup = field(default_factory=ExternalSetup)
    limits: SetpointLimits | None = None
    gcs: Mapping[str, str] = field(default_factory=dict)
    speed: float | None = None
    collision_always: bool = True
    unsigned_commands: bool = False

    def flying(self, mode: Mode) -> tuple[VehicleName, ...]:
        """Return the vehicles that fly in a mode, the subject first; a placed twin does not."""
        return tuple(
            name
            for name in FLIES[mode]
            if mode != "wil" or name != "twin" or self.vehicles[name].coupling != "placed"
        )

    def actors_in(self, mode: Mode) -> tuple[ActorSetup, ...]:
        """Return the actors that fly in a mode: those whose object is in W or Wv then."""
        stands = {each.scene_object.name: each.stands_in for each in self.world.placed}
        flown = (
            actor.flown_as(physical=stands[name](mode, "W"))
            for name, actor in self.actors.items()
            if stands[name](mode, "W") or stands[name](mode, "Wv")
        )
        return tuple(actor for actor in flown if actor is not None)

    def flown_in(self, mode: Mode) -> tuple[FlownSetup, ...]:
        """Return all vehicles that fly in a mode: the pair's, the subject first, and actors."""
        return (*(self.vehicles[name] for name in self.flying(mode)), *self.actors_in(mode))

    def pace(self, mode: Mode) -> float | None:
        """Return how many times real time a case's vehicles fly (scaled clock); None: not given."""
        launched = (one.launch_pace for one in self.flown_in(mode))
        return next((pace for pace in launched if pace is not None), self.speed)

    def needing_wall_clock(self) -> Iterator[tuple[Path, str]]:
        """Yield what in this case needs the wall clock: its path in the campaign, its name."""
        for name, vehicle in self.vehicles.items():
            if vehicle.driver == "mavsdk":
                yield ("vehicles", name, "driver"), f"the driver mavsdk of {name}"
        yield from self.shared_by_runs()

    def shared_by_runs(self) -> Iterator[tuple[Path, str]]:
        """Yield a case's external resources of which there is one, shared by all runs."""
        for name, vehicle in self.vehicles.items():
            if vehicle.mocap is not None:
                yield ("vehicles", name, "mocap"), f"motion capture at {vehicle.mocap.address}"
            for camera in vehicle.cameras:
                if camera.source is not None and camera.source.needs_wall_clock:
                    path = ("vehicles", name, "sensors", camera.name, "source")
                    yield path, f"the camera at {camera.source.address}"
            for sensor, source in vehicle.sourced:
                if source.needs_wall_clock:
                    path = ("vehicles", name, "sensors", sensor.name, "source")
                    yield path, f"the {sensor.kind} at {source.address}"
        if self.under_test.program is not None:
            yield ("autonomy", "program"), f"the program {self.under_test.program[0]}"
        for owner, link in self.gcs.items():
            yield ("operator", "gcs", owner), f"the ground station at {link}"
        yield from self.outside.needing_wall_clock()
