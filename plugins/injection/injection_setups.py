"""The setups of injections, and their checks against campaign, world and vehicles; pure."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

from wil_campaign.campaigns.checks.place_checks import judged_world
from wil_campaign.campaigns.schema import Mode
from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.campaigns.setup.case_setup import FLIES, Case, ObserverSetup, VehicleSetup
from wil_campaign.foundation.files.documents import Path, Problem, closest_word
from wil_campaign.plugins.injection.injection_support import unsupported_injection
from wil_campaign.plugins.injection.rules import InjectionKind
from wil_campaign.recipes.working import Side
from wil_campaign.worlds.frames import Pose, rotate

Injected = Literal[
    "obstacle_distance",
    "distance_sensor",
    "adsb_vehicle",
    "landing_target",
    "vision_position_estimate",
    "odometry",
]

_SENSOR_OF = {"obstacle_distance": "lidar", "distance_sensor": "rangefinder"}
"""The type of sensor from which an injected message is made."""
_OF_OBSTACLES = frozenset({"obstacle_distance", "distance_sensor_sideways"})
_DOWN = 0.7
"""A rangefinder that looks down by this share or more measures height, else proximity."""
_POSES = frozenset({"vision_position_estimate", "odometry"})


@dataclass(frozen=True, slots=True, kw_only=True)
class InjectionSetup:
    """An injection: a MAVLink message that is sent to the autopilots from outside.

    sensor: whose mixed readings it is made of; objects: whose places it is made of. to: the
    vehicles that receive it. rate_hz: None for the default of the autopilot. only_stands_by: its
    range sensor says all the time that nothing is known, so that nothing acts on it.
    """

    thing: Injected
    to: tuple[Side, ...]
    sensor: str | None = None
    objects: tuple[str, ...] = ()
    rate_hz: float | None = None
    only_stands_by: bool = False

    def on_the_way_back(self) -> Iterator["InjectionSetup"]:
        """Yield what a flight back needs of it: poses, and that a lidar stands by.

        Without either an autopilot that listens to it does not arm. Nothing virtual is in the way.
        """
        if self.thing == "obstacle_distance":
            yield replace(self, only_stands_by=True)
        elif self.thing in _POSES and self.sensor is None:
            yield self


@dataclass(frozen=True, slots=True)
class InjectionSetups(ObserverSetup):
    """All injections of a case."""

    injections: tuple[InjectionSetup, ...]

    @property
    def feeds_autopilots(self) -> bool:
        """Return True: autopilots get what is mixed."""
        return True

    def on_the_way_back(self) -> "InjectionSetups | None":
        """Return the injections that a vehicle flies back by; None for none."""
        kept = tuple(back for one in self.injections for back in one.on_the_way_back())
        return InjectionSetups(kept) if kept else None

    def problems(self, files: CaseFiles, case: Case, mode: Mode, /) -> Iterator[Problem]:
        """Yield the problems of one mode's injections."""
        for injection in self.injections:
            yield from _injection(files, case, mode, injection)


def injected_message_name(injected: Injected, mount: Pose | None) -> InjectionKind:
    """Return the injected message's name in the rules; a rangefinder's mount decides."""
    if injected == "distance_sensor" and mount is not None:
        down = rotate(mount.q_wxyz, (1.0, 0.0, 0.0))[2]
        return "distance_sensor" if down >= _DOWN else "distance_sensor_sideways"
    return injected


def mount_of(vehicle: VehicleSetup, sensor: str | None) -> Pose | None:
    """Return the mount of an injected sensor; None without one."""
    sensors = (one for one in vehicle.sensors if one.name == sensor)
    mount = getattr(next(sensors, None), "mount", None)
    return mount if isinstance(mount, Pose) else None


def receives_no_obstacles(twin: VehicleSetup, injection: InjectionSetup) -> bool:
    """Return whether an injection to a twin is of obstacles, which one that follows is not told of.

    They are seen from the real vehicle, which has kept from them already: a twin that keeps from
    them by itself is pushed off the vehicle that it follows.
    """
    if twin.coupling != "follow" or twin.name not in injection.to:
        return False
    return injected_message_name(injection.thing, mount_of(twin, injection.sensor)) in _OF_OBSTACLES


def _injection(
    files: CaseFiles, case: Case, mode: Mode, injection: InjectionSetup
) -> Iterator[Problem]:
    path: Path = ("inject", injection.thing)
    if mode == "wil" and injection.to == ("twin",):
        yield from _reaching_nobody(files, case.vehicles["twin"], path, injection)
    for name in FLIES[mode]:
        if name not in injection.to:
            continue
        vehicle = case.vehicles[name]
        missing = list(_missing_sensors(files, path, vehicle, injection))
        yield from missing
        if mode == "wil" and not missing:
            yield from _unmixed_sensor(files, case, path, vehicle, injection)
        for reason in unsupported_injection(vehicle.autopilot, injection.thing):
            message = f"'{name}' ({vehicle.autopilot}) would ignore it: {reason}"
            yield files.campaign.problem(path, message, key=True)
    scene = case.world.scene(mode, judged_world(mode))
    for index, thing in enumerate(injection.objects):
        at: Path = (*path, "objects", index) if injection.thing != "landing_target" else path
        if thing not in case.world.objects:
            meant = closest_word(thing, case.world.objects)
            yield files.campaign.problem(at, f"no object '{thing}' in the world", meant)
        elif thing not in scene:
            message = f"'{thing}' is not in {judged_world(mode)} in mode {mode}"
            yield files.campaign.problem(at, message)


def _reaching_nobody(
    files: CaseFiles, twin: VehicleSetup, path: Path, injection: InjectionSetup
) -> Iterator[Problem]:
    """Yield an injection of obstacles to none but a twin that follows."""
    if receives_no_obstacles(twin, injection):
        message = (
            "in mode wil nobody is told: a twin that follows keeps from no obstacles by itself"
        )
        remedy = "; write to: [real, twin], or coupling: free for the twin"
        yield files.campaign.problem((*path, "to"), message + remedy)


def _unmixed_sensor(
    files: CaseFiles, case: Case, path: Path, vehicle: VehicleSetup, injection: InjectionSetup
) -> Iterator[Problem]:
    """Yield an injection's sensor that the recipe does not mix for a vehicle."""
    mixed = frozenset[str]() if case.recipe is None else case.recipe.sensors_for(vehicle.name)
    if injection.sensor is not None and injection.sensor not in mixed:
        message = f"the recipe mixes no '{injection.sensor}' for '{vehicle.name}'"
        yield files.campaign.problem(
            (*path, "sensor"), message, closest_word(injection.sensor, mixed)
        )


def _missing_sensors(
    files: CaseFiles, path: Path, vehicle: VehicleSetup, injection: InjectionSetup
) -> Iterator[Problem]:
    """Yield an injection's sensor, or source of poses, that the vehicle lacks."""
    kind = _SENSOR_OF.get(injection.thing)
    if kind is not None:
        fitting = [sensor.name for sensor in vehicle.sensors if sensor.kind == kind]
        if injection.sensor not in fitting:
            message = f"vehicle '{vehicle.name}' has no {kind} '{injection.sensor}'"
            meant = closest_word(injection.sensor or "", fitting)
            yield files.campaign.problem((*path, "sensor"), message, meant)
    if injection.thing in _POSES and injection.sensor is not None:
        fitting = [sensor.name for sensor in vehicle.sensors if sensor.kind == "pose"]
        if injection.sensor not in fitting:
            message = f"vehicle '{vehicle.name}' has no pose '{injection.sensor}'"
            meant = closest_word(injection.sensor, fitting)
            yield files.campaign.problem((*path, "sensor"), message, meant)
    elif injection.thing in _POSES and vehicle.pose_source != "mocap":
        message = f"'{vehicle.name}' has no motion capture: it needs pose_source: mocap"
        yield files.campaign.problem(path, message, key=True)
