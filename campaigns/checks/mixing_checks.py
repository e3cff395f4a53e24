"""Whether a recipe can mix what the sensors of a campaign deliver: names, rates, sizes; pure."""

from collections.abc import Iterator, Mapping

import numpy as np

from campaigns.schema import Mode
from campaigns.setup.case_files import CaseFiles
from campaigns.setup.case_setup import Setup, VehicleSetup
from campaigns.values.sensor_setups import CameraSetup, DepthSetup, LidarSetup, SensorSetup
from recipes.model.recipe import Combination, Recipe
from recipes.pipeline.shape_check import shape_mismatch
from recipes.working import SIDES, Side
from vehicles.readings import CameraReading, DepthReading, LidarScanReading, Reading
from worlds.files.documents import Document, Path, Problem, closest

_SLACK = 1.001
"""A rate that is typed with few digits is the same rate."""


def mixing_problems(files: CaseFiles, setup: Setup, mode: Mode) -> Iterator[Problem]:
    """Yield what a mixture lacks: a recipe, its sensors on a vehicle, its objects in the world."""
    if mode != "wil":
        return
    recipe = setup.recipe
    if recipe is None or files.recipe is None:
        if files.campaign.get(("recipe",)) is None:
            yield files.campaign.problem(("recipe",), "mode wil needs a recipe")
        return
    for name in SIDES:
        if (vehicle := setup.vehicles.get(name)) is None:
            continue
        carried = {sensor.name: sensor.kind for sensor in vehicle.sensors}
        for sensor in recipe.sensors:
            kind = sensor.kind_of(name)
            if carried.get(sensor.name) != kind:
                said = f"vehicle '{name}' has no {kind} '{sensor.name}'"
                meant = closest(sensor.name, carried)
                yield files.recipe.problem(("sensors", sensor.name), said, meant, key=True)
    yield from _rate_problems(files.recipe, recipe, setup)
    yield from _shape_problems(files.recipe, recipe, setup)
    yield from recipe.unknown_objects(frozenset(setup.world.objects))


def _rate_problems(document: Document, recipe: Recipe, setup: Setup) -> Iterator[Problem]:
    """Yield mixtures that are to come more often than the readings that they are made of."""
    carried = _rates_hz(setup.vehicles["real"])
    for sensor in recipe.sensors:
        real_hz = carried.get(sensor.name)
        if sensor.rate_hz is not None and real_hz is not None and sensor.rate_hz > real_hz * _SLACK:
            said = f"the real vehicle's '{sensor.name}' comes {real_hz:g} times a second"
            asked = f"the recipe asks for {sensor.rate_hz:g}"
            yield document.problem(("sensors", sensor.name, "rate_hz"), f"{said}, {asked}")
    for index, combination in enumerate(recipe.combinations):
        path: Path = ("combine", index)
        yield from _least_rate_problems(document, path, combination, carried)
        yield from _skew_problems(document, path, combination, setup)


def _least_rate_problems(
    document: Document, path: Path, combination: Combination, carried: Mapping[str, float | None]
) -> Iterator[Problem]:
    sensor, least_hz = combination.sensor, combination.budget.min_rate_hz
    if least_hz is None:
        return
    at, real_hz = (*path, "min_rate_hz"), carried.get(sensor.name)
    asked = f"the recipe asks for at least {least_hz:g}"
    if real_hz is not None and least_hz > real_hz * _SLACK:
        said = f"the real vehicle's '{sensor.name}' comes {real_hz:g} times a second"
        yield document.problem(at, f"{said}, {asked}")
    elif sensor.rate_hz is not None and least_hz > sensor.rate_hz * _SLACK:
        said = f"'{sensor.name}' is mixed at most {sensor.rate_hz:g} times a second (its rate_hz)"
        yield document.problem(at, f"{said}, {asked}")


def _skew_problems(
    document: Document, path: Path, combination: Combination, setup: Setup
) -> Iterator[Problem]:
    """Yield twins that deliver so seldom that real readings find none within the skew.

    Where the twin is not asked for a moment (`register`), its readings come by themselves: of the
    real ones between two of them some is (T - P) / 2 away from both, with T and P the periods,
    however the two lie to each other.
    """
    timed = any(step.parameters.timed for step in combination.steps)
    if timed or any(step.kind.name == "register" for step in combination.steps):
        return
    name = combination.sensor.name
    real_hz = _rates_hz(setup.vehicles["real"]).get(name)
    twin_hz = _rates_hz(setup.vehicles["twin"]).get(name)
    if real_hz is None or twin_hz is None:
        return
    mixed_hz = min(real_hz, combination.sensor.rate_hz or real_hz)
    skew_s = (1.0 / twin_hz - 1.0 / mixed_hz) / 2.0
    if skew_s > combination.max_skew_s * _SLACK:
        said = (
            f"the twin's '{name}' comes {twin_hz:g} times a second, so that readings of the real "
            f"vehicle are up to {skew_s * 1e3:.0f} ms from it; the recipe asks for at most "
            f"{combination.max_skew_s * 1e3:g} ms (max_skew_ms)"
        )
        yield document.problem((*path, "sensor"), said)


def _shape_problems(document: Document, recipe: Recipe, setup: Setup) -> Iterator[Problem]:
    """Yield steps and merges that do not take pictures or scans of the sizes that come."""
    for combination in recipe.combinations:
        blank: dict[Side, Reading] = {}
        for side in SIDES:
            sensor = _sensor_named(setup.vehicles[side], combination.sensor.name)
            is_fit = sensor is not None and sensor.kind == combination.sensor.kind_of(side)
            reading = _blank_reading(sensor, side) if sensor is not None and is_fit else None
            if reading is not None:
                blank[side] = reading
        if len(blank) < len(SIDES):
            continue
        found = shape_mismatch(combination, blank, recipe.document.path.parent)
        if found is not None:
            sizes = " and ".join(f"{side} {_shape_text(one)}" for side, one in blank.items())
            said = f"{found.message} ('{combination.sensor.name}' of {sizes})"
            yield document.problem(found.path, said, key=True)


def _rates_hz(vehicle: VehicleSetup) -> dict[str, float | None]:
    return {sensor.name: sensor.rate_hz for sensor in vehicle.sensors}


def _sensor_named(vehicle: VehicleSetup, name: str) -> SensorSetup | None:
    return next((sensor for sensor in vehicle.sensors if sensor.name == name), None)


def _blank_reading(sensor: SensorSetup, side: Side) -> Reading | None:
    """Return an empty reading as large as those of a sensor; None for one without a shape."""
    if isinstance(sensor, CameraSetup):
        size = (sensor.intrinsics.height_px, sensor.intrinsics.width_px)
        image = np.zeros((*size, 3), np.uint8)
        return CameraReading(0.0, 0.0, 0, side, image, sensor.intrinsics, sensor=sensor.name)
    if isinstance(sensor, DepthSetup):
        size = (sensor.intrinsics.height_px, sensor.intrinsics.width_px)
        depth_m = np.full(size, np.inf, np.float32)
        return DepthReading(0.0, 0.0, 0, side, depth_m, sensor.intrinsics, sensor=sensor.name)
    if isinstance(sensor, LidarSetup):
        pattern = sensor.pattern
        return LidarScanReading(
            t_s=0.0,
            arrived_s=0.0,
            seq=0,
            source=side,
            ranges_m=np.full(pattern.beams, np.inf, np.float32),
            start_angle_rad=pattern.start_angle_rad,
            step_rad=pattern.step_rad,
            range_min_m=0.0,
            range_max_m=np.inf,
            sensor=sensor.name,
        )
    return None


def _shape_text(reading: Reading) -> str:
    if isinstance(reading, CameraReading | DepthReading):
        return f"{reading.intrinsics.width_px} x {reading.intrinsics.height_px}"
    return f"{len(reading.ranges_m)} beams" if isinstance(reading, LidarScanReading) else ""
