"""What one run needs, resolved and checked: the campaign of one case as frozen values."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from wil_campaign.campaigns.schema import Mode, PreflightPart, RecordPart, SyncPart, VehicleName
from wil_campaign.campaigns.setup.actor_setups import ActorSetup
from wil_campaign.campaigns.setup.autonomy_under_test import UnderTest
from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.campaigns.setup.vehicle_setups import FlownSetup, VehicleSetup
from wil_campaign.campaigns.values.sensor_setups import CameraSetup, SensorSetup
from wil_campaign.campaigns.values.signal_faults import SignalFault
from wil_campaign.foundation.files.documents import Path, Problem
from wil_campaign.recipes.model.recipe import Recipe
from wil_campaign.safety.evaluation.judge import OracleUse
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.guard.core.events import GuardSettings
from wil_campaign.safety.guard.core.setpoint_limits import SetpointLimits
from wil_campaign.vehicles.command_backends import OWN_FRAMES
from wil_campaign.vehicles.coupling import LIMITS_M
from wil_campaign.vehicles.links.link_conditions import LinkLayer
from wil_campaign.worlds.frames import Vec3
from wil_campaign.worlds.world_file.world import World

_USUAL = GuardSettings()

__all__ = [
    "CameraSetup",
    "Case",
    "GoalSetup",
    "GuardingSetup",
    "SensorSetup",
    "SyncSetup",
    "VehicleSetup",
]


FLIES: Mapping[Mode, tuple[VehicleName, ...]] = {
    "sim": ("twin",),
    "wil": ("real", "twin"),
    "real": ("real",),
}
"""The vehicles of each mode; the first is the subject, which is judged. All of them fly, except a
placed twin (`Case.flying`)."""


class SyncSetup(SyncPart):
    """The campaign's `sync`, with what it leaves open: seconds of the run clock, metres."""

    goal_timeout_s: float
    max_twin_distance_m: float = LIMITS_M["follow"]


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


class ObserverSetup:
    """The setup of a plugin's observer of runs, by its key of the campaign; picklable, a base."""

    __slots__ = ()

    @property
    def feeds_autopilots(self) -> bool:
        """Return whether the autopilots themselves get what is mixed."""
        return False

    def link_layer(self, _vehicle: str, _seed: tuple[int, ...], /) -> LinkLayer | None:
        """Return what the link to a vehicle goes through on the air; None for nothing."""
        return None

    def problems(self, _files: CaseFiles, _setup: "Case", _mode: Mode, /) -> Iterator[Problem]:
        """Yield what is wrong with a case in one mode. _setup: of the whole case."""
        yield from ()

    def on_the_way_back(self) -> "ObserverSetup | None":
        """Return what a flight back to the start needs, which mixes nothing; None for nothing."""
        return None

    def needing_wall_clock(self) -> Iterator[tuple[Path, str]]:
        """Yield sockets and devices, shared by all runs: the path in the campaign, the name."""
        yield from ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """The complete setup of one case.

    actors: vehicles that fly as objects of the world, by the object's name. observers: of its runs,
    by their keys of the campaign.
    recipe: None where no mode mixes. fences: of the vehicles and actors that have one;
    fences_on_earth: those of them in degrees; guarding: how the guard keeps them. limits: of
    setpoints; None for none.
    faults: injected into signals.
    collision_always: whether contacts are judged even without the oracle `collision`.
    firmware: versions that `accept` requires, by vehicle.
    permits: what it permits operators that is unsafe, in words, by the key and its value.
    gcs: link strings of ground station ports. speed: of the scaled clock, where no launched
    simulation has one of its own; None where the campaign says none.
    unread: keys of `autonomy.with` that the autonomy never read, each with the one probably meant.
    """

    vehicles: Mapping[VehicleName, VehicleSetup]
    world: World
    recipe: Recipe | None
    under_test: UnderTest
    goal: GoalSetup
    sync: SyncSetup
    fences: Mapping[str, Fence]
    fences_on_earth: frozenset[str] = frozenset()
    oracles: tuple[OracleUse, ...]
    actors: Mapping[str, ActorSetup] = field(default_factory=dict)
    faults: tuple[SignalFault, ...] = ()
    preflight: PreflightPart = field(default_factory=PreflightPart)
    record: RecordPart = field(default_factory=RecordPart)
    guarding: GuardingSetup = GuardingSetup()
    observers: Mapping[str, ObserverSetup] = field(default_factory=dict)
    limits: SetpointLimits | None = None
    gcs: Mapping[str, str] = field(default_factory=dict)
    speed: float | None = None
    collision_always: bool = True
    firmware: Mapping[str, str] = field(default_factory=dict)
    permits: Mapping[str, str] = field(default_factory=dict)
    unread: Mapping[str, str] = field(default_factory=dict)

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
        launched = (flown.launch_pace for flown in self.flown_in(mode))
        return next((pace for pace in launched if pace is not None), self.speed)

    def needing_wall_clock(self) -> Iterator[tuple[Path, str]]:
        """Yield what in this case needs the wall clock: its path in the campaign, its name."""
        for name, vehicle in self.vehicles.items():
            if vehicle.driver != OWN_FRAMES:
                yield ("vehicles", name, "driver"), f"the driver {vehicle.driver} of {name}"
        foreign = self.under_test.foreign
        if foreign is not None and foreign.needs_wall_clock and not foreign.is_shared:
            yield ("autonomy", foreign.kind), foreign.text
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
        foreign = self.under_test.foreign
        if foreign is not None and foreign.needs_wall_clock and foreign.is_shared:
            yield ("autonomy", foreign.kind), foreign.text
        for owner, link in self.gcs.items():
            yield ("operator", "gcs", owner), f"the ground station at {link}"
        for observer in self.observers.values():
            yield from observer.needing_wall_clock()
