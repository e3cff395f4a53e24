"""What one run is given: its plan resolved, its folder, its clock."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from campaigns.expansion.expansion import RunPlan
from campaigns.schema import Mode, VehicleName
from campaigns.setup.case_setup import FLIES, Setup, VehicleSetup
from orchestrator.model.clock import Clock
from orchestrator.model.results import Attempt
from orchestrator.model.return_path import ReturnPath
from vehicles.embedded.profile import Profile, load_profile
from worlds.scene.scene import Scene


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOrder:
    """An order to fly a run; picklable. folder: for its files; it exists and is empty.

    attempts: those at this run that do not count. arm: False for everything up to arming. back: not
    the run, but the flight back to the start after it.
    """

    plan: RunPlan
    folder: Path
    clock: Clock
    attempts: tuple[Attempt, ...] = ()
    arm: bool = True
    back: ReturnPath | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSetup:
    """The setup of a run: an order with all that it names resolved.

    vehicles: those that fly. real_scene, virtual_scene: what stands in W and in Wv in this mode.
    """

    order: RunOrder
    campaign: Setup
    vehicles: tuple[VehicleSetup, ...]
    profiles: Mapping[VehicleName, Profile]
    real_scene: Scene
    virtual_scene: Scene

    @classmethod
    def of(cls, order: RunOrder) -> Self:
        """Return the setup of an order. Raises BadInput, ProfileError."""
        campaign, mode = order.plan.setup(), order.plan.mode
        vehicles = tuple(campaign.vehicles[name] for name in FLIES[mode])
        return cls(
            order=order,
            campaign=campaign,
            vehicles=vehicles,
            profiles={vehicle.name: load_profile(vehicle.profile) for vehicle in vehicles},
            real_scene=campaign.world.scene(mode, "W"),
            virtual_scene=campaign.world.scene(mode, "Wv"),
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
        """Return the pace of the run's clock in times real time; 1 for what is not scaled."""
        asked = self.campaign.pace(FLIES[self.mode]) if self.clock == "scaled" else None
        return asked or 1.0

    @property
    def subject(self) -> VehicleName:
        """Return the vehicle that the run's required oracles judge: twin in sim, else real."""
        return "twin" if self.mode == "sim" else "real"

    @property
    def judged_scene(self) -> Scene:
        """Return the scene against which the run's poses are judged."""
        return self.real_scene if self.mode == "real" else self.virtual_scene

    def vehicle(self, name: str) -> VehicleSetup:
        """Return a vehicle that flies in the run. Raises StopIteration for another."""
        return next(one for one in self.vehicles if one.name == name)

    def height_m(self, vehicle: VehicleSetup) -> float:
        """Return how far above its start a vehicle of the run takes off to."""
        return self.campaign.goal.altitude_m + vehicle.start.position_ned_m[2]
