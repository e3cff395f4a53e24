"""What is wrong between a campaign and the world outside of it; pure."""

from collections.abc import Iterator

from campaigns.checks.place_checks import judged_world
from campaigns.schema import Mode, VehicleName
from campaigns.setup.case_files import CaseFiles
from campaigns.setup.case_setup import Setup, VehicleSetup
from campaigns.values.external_setups import ImageOutlet, InjectionSetup
from vehicles.autopilots.injection_support.injection_support import unsupported_injection
from worlds.files.documents import Path, Problem, closest

_FLIES: dict[Mode, tuple[VehicleName, ...]] = {
    "sim": ("twin",),
    "wil": ("real", "twin"),
    "real": ("real",),
}
_MADE_OF = {"obstacle_distance": "lidar", "distance_sensor": "rangefinder"}
"""Of which type of sensor a thing is made."""
_POSES = frozenset({"vision_position_estimate", "odometry"})


def external_problems(files: CaseFiles, setup: Setup, mode: Mode) -> Iterator[Problem]:
    """Yield the problems of one mode's external sources, deliveries and injections."""
    yield from _sources_to_be_asked(files, setup, mode)
    yield from _sources_without_link(files, setup, mode)
    seen: dict[str, int] = {}
    for index, outlet in enumerate(setup.outside.pictures):
        yield from _outlet(files, setup, mode, index, outlet)
        first = seen.setdefault(outlet.name, index)
        if first != index:
            said = f"{outlet.name} is used by delivery {first + 1}"
            yield files.campaign.problem(("deliver", index), said)
    for injection in setup.outside.injections:
        yield from _injection(files, setup, mode, injection)


def _sources_to_be_asked(files: CaseFiles, setup: Setup, mode: Mode) -> Iterator[Problem]:
    """Yield external twin cameras that `register` needs on request and that only stream."""
    if mode != "wil" or setup.recipe is None:
        return
    asked = {
        combination.sensor.name
        for combination in setup.recipe.combinations
        if any(step.kind.name == "register" for step in combination.steps)
    }
    for sensor, source in setup.vehicles["twin"].sourced:
        if sensor.name in asked:
            path = ("vehicles", "twin", "sensors", sensor.name, "source")
            said = (
                f"the recipe registers '{sensor.name}', and {source.address} cannot be asked for a "
                "reading from another pose: leave out `source`, or leave out `register`"
            )
            yield files.campaign.problem(path, said)
    for camera in setup.vehicles["twin"].cameras:
        if camera.name in asked and camera.source is not None and not camera.source.asked:
            path = ("vehicles", "twin", "sensors", camera.name, "source")
            said = (
                f"the recipe registers '{camera.name}', and {camera.source.address} cannot be "
                "asked for a picture from another pose: leave out `source`, name a simulator "
                "(tcp://HOST:PORT), or leave out `register`"
            )
            yield files.campaign.problem(path, said)


def _sources_without_link(files: CaseFiles, setup: Setup, mode: Mode) -> Iterator[Problem]:
    """Yield sensors that a vehicle sends on its link, of a twin that has none."""
    if mode != "wil" or setup.vehicles["twin"].coupling != "placed":
        return
    for sensor, source in setup.vehicles["twin"].sourced:
        if source.kind == "mavlink":
            path = ("vehicles", "twin", "sensors", sensor.name, "source")
            said = "the twin is placed: nothing flies it, so that it sends nothing by MAVLink"
            yield files.campaign.problem(path, f"{said}; leave out `source`")


def _outlet(
    files: CaseFiles, setup: Setup, mode: Mode, index: int, outlet: ImageOutlet
) -> Iterator[Problem]:
    """Yield the problems of an external image outlet (`deliver`) in a mode."""
    path: Path = ("deliver", index)
    wanted = _whose(outlet, mode)
    if wanted not in _FLIES[mode]:
        return  # nothing of this vehicle is seen in this mode
    cameras = [camera.name for camera in setup.vehicles[wanted].cameras]
    if outlet.sensor not in cameras:
        said = f"vehicle '{wanted}' has no camera '{outlet.sensor}'"
        yield files.campaign.problem((*path, "sensor"), said, closest(outlet.sensor, cameras))


def _whose(outlet: ImageOutlet, mode: Mode) -> VehicleName:
    """Return which vehicle's images an external image outlet delivers in a mode."""
    if outlet.of == "perceived":
        return outlet.vehicle or _FLIES[mode][0]
    return outlet.of


def _injection(
    files: CaseFiles, setup: Setup, mode: Mode, injection: InjectionSetup
) -> Iterator[Problem]:
    """Yield the problems of an injection into the autopilots in a mode."""
    path: Path = ("inject", injection.thing)
    for name in _FLIES[mode]:
        if name not in injection.to:
            continue
        vehicle = setup.vehicles[name]
        yield from _made_of(files, path, vehicle, injection)
        for reason in unsupported_injection(vehicle.autopilot, injection.thing):
            said = f"'{name}' ({vehicle.autopilot}) would ignore it: {reason}"
            yield files.campaign.problem(path, said, key=True)
    scene = setup.world.scene(mode, judged_world(mode))
    for index, thing in enumerate(injection.objects):
        at: Path = (*path, "objects", index) if injection.thing != "landing_target" else path
        if thing not in setup.world.objects:
            meant = closest(thing, setup.world.objects)
            yield files.campaign.problem(at, f"no object '{thing}' in the world", meant)
        elif thing not in scene:
            said = f"'{thing}' is not in {judged_world(mode)} in mode {mode}"
            yield files.campaign.problem(at, said)


def _made_of(
    files: CaseFiles, path: Path, vehicle: VehicleSetup, injection: InjectionSetup
) -> Iterator[Problem]:
    """Yield an injection's sensors or world objects that the vehicle or the world lacks."""
    kind = _MADE_OF.get(injection.thing)
    if kind is not None:
        fitting = [sensor.name for sensor in vehicle.sensors if sensor.kind == kind]
        if injection.sensor not in fitting:
            said = f"vehicle '{vehicle.name}' has no {kind} '{injection.sensor}'"
            meant = closest(injection.sensor or "", fitting)
            yield files.campaign.problem((*path, "sensor"), said, meant)
    if injection.thing in _POSES and injection.sensor is not None:
        fitting = [sensor.name for sensor in vehicle.sensors if sensor.kind == "pose"]
        if injection.sensor not in fitting:
            said = f"vehicle '{vehicle.name}' has no pose '{injection.sensor}'"
            meant = closest(injection.sensor, fitting)
            yield files.campaign.problem((*path, "sensor"), said, meant)
    elif injection.thing in _POSES and vehicle.pose_source != "mocap":
        said = f"'{vehicle.name}' has no motion capture: it needs pose_source: mocap"
        yield files.campaign.problem((*path,), said, key=True)
