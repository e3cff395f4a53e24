"""Checks of external I/O: sensor sources, deliveries of images, injections; pure."""

from collections.abc import Iterator

from campaigns.checks.place_checks import judged_world
from campaigns.schema import Mode, VehicleName
from campaigns.setup.case_files import CaseFiles
from campaigns.setup.case_setup import FLIES, Setup, VehicleSetup
from campaigns.values.external_setups import ImageOutlet, InjectionSetup
from vehicles.autopilots.injection_support.injection_support import unsupported_injection
from worlds.files.documents import Path, Problem, closest

_SENSOR_OF = {"obstacle_distance": "lidar", "distance_sensor": "rangefinder"}
"""The type of sensor from which an injected message is made."""
_POSES = frozenset({"vision_position_estimate", "odometry"})


def external_problems(files: CaseFiles, setup: Setup, mode: Mode) -> Iterator[Problem]:
    """Yield the problems of one mode's external sources, deliveries and injections."""
    yield from _sources_without_requests(files, setup, mode)
    yield from _sources_without_link(files, setup, mode)
    seen: dict[str, int] = {}
    for index, outlet in enumerate(setup.outside.outlets):
        yield from _outlet(files, setup, mode, index, outlet)
        first = seen.setdefault(outlet.name, index)
        if first != index:
            message = f"{outlet.name} is already used by delivery {first + 1}"
            yield files.campaign.problem(("deliver", index), message)
    for injection in setup.outside.injections:
        yield from _injection(files, setup, mode, injection)


def _sources_without_requests(files: CaseFiles, setup: Setup, mode: Mode) -> Iterator[Problem]:
    """Yield external sources of the twin that only stream, where `register` needs requests."""
    if mode != "wil" or setup.recipe is None:
        return
    registered = {
        combination.sensor.name
        for combination in setup.recipe.combinations
        if any(step.kind.name == "register" for step in combination.steps)
    }
    for sensor, source in setup.vehicles["twin"].sourced:
        if sensor.name in registered:
            path = ("vehicles", "twin", "sensors", sensor.name, "source")
            message = (
                f"the recipe registers '{sensor.name}', but {source.address} cannot provide a "
                "reading from a requested pose: remove `source`, or remove `register`"
            )
            yield files.campaign.problem(path, message)
    for camera in setup.vehicles["twin"].cameras:
        if (
            camera.name in registered
            and camera.source is not None
            and not camera.source.renders_on_request
        ):
            path = ("vehicles", "twin", "sensors", camera.name, "source")
            message = (
                f"the recipe registers '{camera.name}', but {camera.source.address} cannot "
                "provide an image from a requested pose: remove `source`, name a simulator "
                "(tcp://HOST:PORT), or remove `register`"
            )
            yield files.campaign.problem(path, message)


def _sources_without_link(files: CaseFiles, setup: Setup, mode: Mode) -> Iterator[Problem]:
    """Yield MAVLink sources of a placed twin, which has no link."""
    if mode != "wil" or setup.vehicles["twin"].coupling != "placed":
        return
    for sensor, source in setup.vehicles["twin"].sourced:
        if source.kind == "mavlink":
            path = ("vehicles", "twin", "sensors", sensor.name, "source")
            message = "a placed twin does not fly and sends no MAVLink messages; remove `source`"
            yield files.campaign.problem(path, message)


def _outlet(
    files: CaseFiles, setup: Setup, mode: Mode, index: int, outlet: ImageOutlet
) -> Iterator[Problem]:
    """Yield the problems of an external image outlet (`deliver`) in a mode."""
    path: Path = ("deliver", index)
    wanted = _vehicle_of(outlet, mode)
    if wanted not in FLIES[mode]:
        return  # this vehicle is not part of this mode
    cameras = [camera.name for camera in setup.vehicles[wanted].cameras]
    if outlet.sensor not in cameras:
        message = f"vehicle '{wanted}' has no camera '{outlet.sensor}'"
        yield files.campaign.problem((*path, "sensor"), message, closest(outlet.sensor, cameras))


def _vehicle_of(outlet: ImageOutlet, mode: Mode) -> VehicleName:
    """Return which vehicle's images an external image outlet delivers in a mode."""
    if outlet.of == "perceived":
        return outlet.vehicle or FLIES[mode][0]
    return outlet.of


def _injection(
    files: CaseFiles, setup: Setup, mode: Mode, injection: InjectionSetup
) -> Iterator[Problem]:
    """Yield the problems of an injection into the autopilots in a mode."""
    path: Path = ("inject", injection.thing)
    for name in FLIES[mode]:
        if name not in injection.to:
            continue
        vehicle = setup.vehicles[name]
        yield from _missing_sensors(files, path, vehicle, injection)
        for reason in unsupported_injection(vehicle.autopilot, injection.thing):
            message = f"'{name}' ({vehicle.autopilot}) would ignore it: {reason}"
            yield files.campaign.problem(path, message, key=True)
    scene = setup.world.scene(mode, judged_world(mode))
    for index, thing in enumerate(injection.objects):
        at: Path = (*path, "objects", index) if injection.thing != "landing_target" else path
        if thing not in setup.world.objects:
            meant = closest(thing, setup.world.objects)
            yield files.campaign.problem(at, f"no object '{thing}' in the world", meant)
        elif thing not in scene:
            message = f"'{thing}' is not in {judged_world(mode)} in mode {mode}"
            yield files.campaign.problem(at, message)


def _missing_sensors(
    files: CaseFiles, path: Path, vehicle: VehicleSetup, injection: InjectionSetup
) -> Iterator[Problem]:
    """Yield an injection's sensor, or source of poses, that the vehicle lacks."""
    kind = _SENSOR_OF.get(injection.thing)
    if kind is not None:
        fitting = [sensor.name for sensor in vehicle.sensors if sensor.kind == kind]
        if injection.sensor not in fitting:
            message = f"vehicle '{vehicle.name}' has no {kind} '{injection.sensor}'"
            meant = closest(injection.sensor or "", fitting)
            yield files.campaign.problem((*path, "sensor"), message, meant)
    if injection.thing in _POSES and injection.sensor is not None:
        fitting = [sensor.name for sensor in vehicle.sensors if sensor.kind == "pose"]
        if injection.sensor not in fitting:
            message = f"vehicle '{vehicle.name}' has no pose '{injection.sensor}'"
            meant = closest(injection.sensor, fitting)
            yield files.campaign.problem((*path, "sensor"), message, meant)
    elif injection.thing in _POSES and vehicle.pose_source != "mocap":
        message = f"'{vehicle.name}' has no motion capture: it needs pose_source: mocap"
        yield files.campaign.problem(path, message, key=True)
