"""Order and setup of one run: its resolved plan, its folder, its clock."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from wil_campaign.campaigns.expansion.expansion import RunPlan
from wil_campaign.campaigns.schema import Mode, VehicleName
from wil_campaign.campaigns.setup.actor_setups import ActorSetup
from wil_campaign.campaigns.setup.case_setup import FLIES, Case, VehicleSetup
from wil_campaign.campaigns.setup.vehicle_setups import FlownSetup
from wil_campaign.foundation.clocks.virtual_loop import Clock
from wil_campaign.orchestrator.run_results.run_result import EarlierAttempt
from wil_campaign.orchestrator.state.return_path import ReturnPath
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.embedded.profile import Profile, load_profile
from wil_campaign.worlds.scene.scene import Scene


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOrder:
    """An order to fly a run; picklable. folder: for its files; it exists and is empty.

    liftoff_delays_s: by vehicle, from takeoff command to liftoff, as earlier runs measured them;
    attempts: earlier ones at this run, which do not count. arm: False stops before arming. back:
    set for the return flight to the start after the run, instead of the run. campaign: the results
    folder of the campaign on its own machine, by which guards on any machine say whose they are.
    beneath: the folder of this machine beneath which the files of that machine lie. uids: of the
    attached vehicles that were cleared to fly, by `place_of_vehicle`; others fly whoever they are.
    """

    plan: RunPlan
    folder: Path
    clock: Clock
    attempts: tuple[EarlierAttempt, ...] = ()
    arm: bool = True
    back: ReturnPath | None = None
    liftoff_delays_s: Mapping[str, float] = field(default_factory=dict)
    campaign: Path | None = None
    beneath: Path | None = None
    uids: Mapping[str, str] = field(default_factory=dict)

    def own_path(self, path: Path) -> Path:
        """Return where a file of the order lies on the campaign's own machine."""
        if self.beneath is None or not path.is_relative_to(self.beneath):
            return path
        return Path("/") / path.relative_to(self.beneath)


def place_of_vehicle(vehicle: FlownSetup) -> str:
    """Return a vehicle's name and the address of its link: cases may have several of a name."""
    return f"{vehicle.name} at {vehicle.attached or vehicle.link}"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSetup:
    """The setup of a run: an order with its references resolved.

    vehicles: those that fly. placed: a twin that does not fly, with sensors at the real vehicle's
    pose. actors: the vehicles that fly as objects of the world in this mode. real_scene,
    virtual_scene: scenes W and Wv in this mode.
    """

    order: RunOrder
    case: Case
    vehicles: tuple[VehicleSetup, ...]
    profiles: Mapping[str, Profile]
    real_scene: Scene
    virtual_scene: Scene
    placed: VehicleSetup | None = None
    actors: tuple[ActorSetup, ...] = ()

    @classmethod
    def of(cls, order: RunOrder) -> Self:
        """Return the setup of an order. Raises BadInput, ProfileError."""
        case, mode = order.plan.setup(), order.plan.mode
        there = tuple(case.vehicles[name] for name in FLIES[mode])
        flying = case.flying(mode)
        real_scene, virtual_scene = (case.world.scene(mode, which) for which in ("W", "Wv"))
        actors = case.actors_in(mode)
        return cls(
            order=order,
            case=case,
            vehicles=tuple(one for one in there if one.name in flying),
            placed=next((one for one in there if one.name not in flying), None),
            profiles={vehicle.name: load_profile(vehicle.profile) for vehicle in (*there, *actors)},
            real_scene=real_scene,
            virtual_scene=virtual_scene,
            actors=actors,
        )

    @property
    def mode(self) -> Mode:
        """Return the mode of the run."""
        return self.order.plan.mode

    @property
    def seed(self) -> int:
        """Return the seed of the run."""
        return self.order.plan.seed

    @property
    def clock(self) -> Clock:
        """Return the clock that the run is flown on."""
        return self.order.clock

    @property
    def pace(self) -> float:
        """Return the pace of the run's clock in times real time; 1 unless it is scaled."""
        pace = self.case.pace(self.mode) if self.clock == "scaled" else None
        return pace or 1.0

    @property
    def subject(self) -> VehicleName:
        """Return the vehicle that the run's required oracles judge: twin in sim, else real."""
        return "twin" if self.mode == "sim" else "real"

    @property
    def companion(self) -> VehicleName | None:
        """Return the twin that flies beside the subject and is not judged; None without one."""
        return "twin" if self.mode == "wil" and self.placed is None else None

    @property
    def with_sensors(self) -> tuple[VehicleSetup, ...]:
        """Return the vehicles with sensors: those that fly, and a placed twin."""
        return self.vehicles if self.placed is None else (*self.vehicles, self.placed)

    @property
    def guarded(self) -> tuple[FlownSetup, ...]:
        """Return all vehicles of the run that fly, behind one guard: the pair's, and actors."""
        return (*self.vehicles, *self.actors)

    def flown(self, name: str) -> FlownSetup:
        """Return a vehicle of the run that flies. Raises StopIteration for another."""
        return next(one for one in self.guarded if one.name == name)

    @property
    def judged_scene(self) -> Scene:
        """Return the scene against which the run's poses are judged."""
        return self.real_scene if self.mode == "real" else self.virtual_scene

    def vehicle(self, name: str) -> VehicleSetup:
        """Return a vehicle of the run that flies or is placed. Raises StopIteration for another."""
        return next(with_sensor for with_sensor in self.with_sensors if with_sensor.name == name)

    @property
    def liftoff_delays_s(self) -> Mapping[str, float]:
        """Return how long each vehicle takes from its takeoff command to its liftoff.

        As measured in earlier runs, else the default of its autopilot; empty where the commands are
        to be sent together.
        """
        if self.case.sync.takeoff == "command":
            return {}
        known: dict[str, float] = {one.name: _liftoff_s(one) for one in self.vehicles}
        return {**known, **self.order.liftoff_delays_s}

    def height_m(self, vehicle: VehicleSetup) -> float:
        """Return the takeoff height of a vehicle above its start."""
        return self.case.goal.altitude_m + vehicle.start.position_ned_m[2]


def _liftoff_s(vehicle: VehicleSetup) -> float:
    """Return how long vehicles of this kind take to lift off after their takeoff command."""
    autopilot = autopilot_named(vehicle.autopilot)
    return autopilot.embedded_liftoff_s if vehicle.embedded else autopilot.liftoff_s
