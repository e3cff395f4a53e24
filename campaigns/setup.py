"""What one run needs, resolved and checked: the campaign of one case as frozen values."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

from campaigns.link_setups import LinkSetup
from campaigns.outside_setups import ESTIMATED, MocapSetup, OutsideSetup, PoseAccuracy
from campaigns.schema import PictureFormat, VehicleName
from campaigns.sensor_setups import CameraSetup, SensorSetup
from campaigns.under_test import UnderTest
from recipes.recipe import Recipe
from safety.geofence import Fence
from safety.guard.events import GuardSettings
from safety.guard.limits import SetpointLimits
from safety.judge import OracleUse
from vehicles.autopilots.base import AutopilotName
from worlds.documents import Path
from worlds.frames import Pose, Vec3
from worlds.world import World

_USUAL = GuardSettings()

__all__ = [
    "CameraSetup",
    "GoalSetup",
    "GuardingSetup",
    "LinkSetup",
    "RecordSetup",
    "SensorSetup",
    "Setup",
    "SyncSetup",
    "VehicleSetup",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleSetup:
    """A vehicle. link: "embedded". profile: for `load_profile`: a name, or an absolute path.

    params: autopilot parameters by name. start: where it stands, world frame. mocap: None: the
    surrogate's own motion capture. pose_accuracy: of its pose source.
    """

    name: VehicleName
    link: str
    autopilot: AutopilotName
    profile: str
    start: Pose
    anchor: Literal["start"] = "start"
    pose_source: Literal["mavlink", "mocap"] = "mavlink"
    mocap: MocapSetup | None = None
    pose_accuracy: PoseAccuracy = ESTIMATED
    params: Mapping[str, float] = field(default_factory=dict)
    sensors: tuple[SensorSetup, ...] = ()

    @property
    def cameras(self) -> tuple[CameraSetup, ...]:
        """Return its cameras."""
        return tuple(one for one in self.sensors if isinstance(one, CameraSetup))


@dataclass(frozen=True, slots=True, kw_only=True)
class SyncSetup:
    """How closely the pair keeps together; seconds of the run clock, metres."""

    ready_timeout_s: float
    takeoff_timeout_s: float
    takeoff_tolerance_m: float
    goal_timeout_s: float
    landing_timeout_s: float
    max_command_skew_s: float
    max_takeoff_skew_s: float
    max_t0_skew_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class GoalSetup:
    """The goal. altitude_m: over the world's origin. gates: object names, in their order."""

    altitude_m: float
    gates: tuple[str, ...] = ()
    position_ned_m: Vec3 | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordSetup:
    """What run.mcap holds of pictures. quality: of JPEG, 1 to 100."""

    pictures: PictureFormat = "jpeg"
    quality: int = 85


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardingSetup:
    """How the guard keeps vehicles inside of their fences; see `GuardSettings`."""

    keep_m: float = _USUAL.keep_m
    latency_s: float = _USUAL.latency_s
    braking_m_s2: float = _USUAL.braking_m_s2


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """All of one case.

    recipe: None where no mode mixes. fences: of the vehicles that have one; guarding: how the guard
    keeps them. limits: of setpoints; None for none. links: those that are made worse than they are.
    gcs: link strings of ground station ports.
    """

    vehicles: Mapping[VehicleName, VehicleSetup]
    world: World
    recipe: Recipe | None
    under_test: UnderTest
    goal: GoalSetup
    sync: SyncSetup
    fences: Mapping[VehicleName, Fence]
    oracles: tuple[OracleUse, ...]
    links: Mapping[VehicleName, LinkSetup] = field(default_factory=dict)
    record: RecordSetup = RecordSetup()
    guarding: GuardingSetup = GuardingSetup()
    outside: OutsideSetup = field(default_factory=OutsideSetup)
    limits: SetpointLimits | None = None
    gcs: Mapping[VehicleName, str] = field(default_factory=dict)

    def needing_wall_clock(self) -> Iterator[tuple[Path, str]]:
        """Yield what this case has outside of this process: its path in the campaign, its name."""
        for name, vehicle in self.vehicles.items():
            if vehicle.mocap is not None:
                yield ("vehicles", name, "mocap"), f"motion capture at {vehicle.mocap.address}"
            for camera in vehicle.cameras:
                if camera.source is not None and camera.source.needs_wall_clock:
                    path = ("vehicles", name, "sensors", camera.name, "source")
                    yield path, f"the camera at {camera.source.address}"
        if self.under_test.program is not None:
            yield ("autonomy", "program"), f"the program {self.under_test.program[0]}"
        for name, link in self.gcs.items():
            yield ("operator", "gcs", name), f"the ground station at {link}"
        yield from self.outside.needing_wall_clock()
