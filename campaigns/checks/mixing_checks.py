"""Check that a recipe can mix the readings of a campaign's sensors: names, rates, sizes; pure."""

from collections.abc import Iterator, Mapping

from wil_campaign.campaigns.schema import Mode
from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.campaigns.setup.case_setup import Case, VehicleSetup
from wil_campaign.campaigns.values.sensor_setups import SensorSetup
from wil_campaign.foundation.files.documents import Document, Path, Problem, closest_word
from wil_campaign.recipes.model.recipe import Combination, Recipe
from wil_campaign.recipes.pipeline.shape_check import blank_reading_of, shape_mismatch
from wil_campaign.recipes.working import SIDES, Side
from wil_campaign.vehicles.readings import Reading
from wil_campaign.vehicles.readings.kinds import traits_named, traits_of

_SLACK = 1.001
"""Tolerance for rates that are typed with few digits."""


def mixing_problems(files: CaseFiles, case: Case, mode: Mode) -> Iterator[Problem]:
    """Yield missing parts of a mixture: the recipe, sensors on a vehicle, objects in the world."""
    if mode != "wil":
        return
    recipe = case.recipe
    if recipe is None or files.recipe is None:
        if files.campaign.get(("recipe",)) is None:
            yield files.campaign.problem(("recipe",), "mode wil needs a recipe")
        return
    for name in SIDES:
        if (vehicle := case.vehicles.get(name)) is None:
            continue
        carried = {sensor.name: sensor.kind for sensor in vehicle.sensors}
        for sensor in recipe.sensors:
            kind = sensor.kind_of(name)
            if (found := carried.get(sensor.name)) != kind:
                message = f"vehicle '{name}' has no {kind} '{sensor.name}'"
                meant = "" if found else closest_word(sensor.name, carried)
                if found:
                    message += f": its '{sensor.name}' is of type {found}"
                yield files.recipe.problem(("sensors", sensor.name), message, meant, key=True)
    yield from _rate_problems(files.recipe, recipe, case)
    yield from _shape_problems(files.recipe, recipe, case)
    yield from recipe.unknown_objects(frozenset(case.world.objects))


def _rate_problems(document: Document, recipe: Recipe, case: Case) -> Iterator[Problem]:
    """Yield mixtures whose rate is above that of the readings that they are made of."""
    carried = _rates_hz(case.vehicles["real"])
    for sensor in recipe.sensors:
        real_hz = carried.get(sensor.name)
        if sensor.rate_hz is not None and real_hz is not None and sensor.rate_hz > real_hz * _SLACK:
            message = f"the real vehicle's '{sensor.name}' has a rate of {real_hz:g} Hz"
            wanted = f"the recipe asks for {sensor.rate_hz:g} Hz"
            yield document.problem(("sensors", sensor.name, "rate_hz"), f"{message}, {wanted}")
    for index, combination in enumerate(recipe.combinations):
        path: Path = ("combine", index)
        yield from _least_rate_problems(document, path, combination, carried)
        yield from _skew_problems(document, path, combination, case)


def _least_rate_problems(
    document: Document, path: Path, combination: Combination, carried: Mapping[str, float | None]
) -> Iterator[Problem]:
    sensor, least_hz = combination.sensor, combination.budget.min_rate_hz
    if least_hz is None:
        return
    at, real_hz = (*path, "min_rate_hz"), carried.get(sensor.name)
    wanted = f"the recipe asks for at least {least_hz:g} Hz"
    if real_hz is not None and least_hz > real_hz * _SLACK:
        message = f"the real vehicle's '{sensor.name}' has a rate of {real_hz:g} Hz"
        yield document.problem(at, f"{message}, {wanted}")
    elif sensor.rate_hz is not None and least_hz > sensor.rate_hz * _SLACK:
        message = f"'{sensor.name}' is mixed at {sensor.rate_hz:g} Hz at most (its rate_hz)"
        yield document.problem(at, f"{message}, {wanted}")


def _skew_problems(
    document: Document, path: Path, combination: Combination, case: Case
) -> Iterator[Problem]:
    """Yield sensors of the twin so slow that some real readings have no partner within the skew.

    Without `register` the twin's readings are streamed. Whatever the phase, some real reading is
    (T - P) / 2 away from both of its neighbours, with T the twin's period and P the mixture's. Of
    readings that last, as sound, the part of the same time is used, however long they are.
    """
    timed = any(step.parameters.timed for step in combination.steps)
    if (
        traits_named(combination.sensor.kind).line is not None
        or timed
        or any(step.kind.name == "register" for step in combination.steps)
    ):
        return
    name = combination.sensor.name
    real_hz = _rates_hz(case.vehicles["real"]).get(name)
    twin_hz = _rates_hz(case.vehicles["twin"]).get(name)
    if real_hz is None or twin_hz is None:
        return
    mixed_hz = min(real_hz, combination.sensor.rate_hz or real_hz)
    skew_s = (1.0 / twin_hz - 1.0 / mixed_hz) / 2.0
    if skew_s > combination.max_skew_s * _SLACK:
        message = (
            f"the twin's '{name}' has a rate of {twin_hz:g} Hz, so that readings of the real "
            f"vehicle are up to {skew_s * 1e3:.0f} ms from its nearest reading; the recipe allows "
            f"{combination.max_skew_s * 1e3:g} ms (max_skew_ms)"
        )
        yield document.problem((*path, "sensor"), message)


def _shape_problems(document: Document, recipe: Recipe, case: Case) -> Iterator[Problem]:
    """Yield steps and merges that do not accept images or scans of the sensors' sizes."""
    for combination in recipe.combinations:
        blank: dict[Side, Reading] = {}
        for side in SIDES:
            sensor = _sensor_named(case.vehicles[side], combination.sensor.name)
            is_fit = sensor is not None and sensor.kind == combination.sensor.kind_of(side)
            reading = blank_reading_of(sensor, side) if sensor is not None and is_fit else None
            if reading is not None:
                blank[side] = reading
        if len(blank) < len(SIDES):
            continue
        mismatch = shape_mismatch(combination, blank, recipe.document.path.parent)
        if mismatch is not None:
            sizes = " and ".join(
                f"{side} {traits_of(type(one)).size(one)}" for side, one in blank.items()
            )
            message = f"{mismatch.message} ('{combination.sensor.name}' of {sizes})"
            yield document.problem(mismatch.path, message, key=True)


def _rates_hz(vehicle: VehicleSetup) -> dict[str, float | None]:
    return {sensor.name: sensor.rate_hz for sensor in vehicle.sensors}


def _sensor_named(vehicle: VehicleSetup, name: str) -> SensorSetup | None:
    return next((sensor for sensor in vehicle.sensors if sensor.name == name), None)
