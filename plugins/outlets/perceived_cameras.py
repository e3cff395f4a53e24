"""The cameras whose images an autonomy perceives, with the size that the recipe gives these."""

from dataclasses import replace

from wil_campaign.campaigns.schema import Mode, VehicleName
from wil_campaign.campaigns.setup.case_setup import Case
from wil_campaign.campaigns.values.sensor_setups import CameraSetup, SensorSetup
from wil_campaign.recipes.model.recipe import Combination, Recipe
from wil_campaign.recipes.pipeline.shape_check import blank_mixture, blank_reading_of
from wil_campaign.recipes.working import SIDES
from wil_campaign.vehicles.readings import CameraReading


def perceived_cameras(case: Case, mode: Mode, vehicle: VehicleName) -> tuple[CameraSetup, ...]:
    """Return the cameras that a vehicle's autonomy perceives: mixed ones first, then its own.

    Intrinsics and rate are those of the images that arrive.
    """
    recipe = case.recipe if mode == "wil" else None
    combinations = () if recipe is None else recipe.combinations
    mixed = [combination for combination in combinations if vehicle in combination.publish]
    cameras = () if recipe is None else tuple(_mixed_camera(case, recipe, one) for one in mixed)
    names = {one.sensor.name for one in mixed}
    own = (one for one in case.vehicles[vehicle].cameras if one.name not in names)
    return (*(camera for camera in cameras if camera is not None), *own)


def _mixed_camera(case: Case, recipe: Recipe, combination: Combination) -> CameraSetup | None:
    """Return the real camera as its mixtures show it; None where a combination mixes no images."""
    sensor = combination.sensor
    carried = {side: _sensor_named(case, side, sensor.name) for side in SIDES}
    camera = carried["real"]
    if sensor.kind != "camera" or not isinstance(camera, CameraSetup):
        return None
    readings = ((side, blank_reading_of(one, side)) for side, one in carried.items())
    blank = {side: reading for side, reading in readings if reading is not None}
    mixture = blank_mixture(combination, blank, recipe.document.path.parent)
    return replace(
        camera,
        intrinsics=mixture.intrinsics if isinstance(mixture, CameraReading) else camera.intrinsics,
        rate_hz=sensor.rate_hz or camera.rate_hz,
    )


def _sensor_named(case: Case, vehicle: VehicleName, name: str) -> SensorSetup:
    """Return the sensor of a vehicle that a recipe mixes, which the checks found there."""
    return next(sensor for sensor in case.vehicles[vehicle].sensors if sensor.name == name)
