"""Warnings of objects that a recipe leaves unchecked or unmixed, probably unintended; pure."""

from collections.abc import Iterator

from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.campaigns.setup.case_setup import Case
from wil_campaign.campaigns.setup.named_objects import named_objects
from wil_campaign.campaigns.values.sensor_setups import CameraSetup, DepthSetup
from wil_campaign.foundation.files.documents import Document, Problem
from wil_campaign.recipes.model.recipe import Combination
from wil_campaign.vehicles.readings.kinds import traits_named
from wil_campaign.worlds.scene.scene import virtual_only_objects

_WIDE_SHARE = 0.05
"""Of the image's width: the default limit of an object that takes half of it. With a larger limit
an object beside its place counts as in its place."""


def wide_registration_warnings(files: CaseFiles, case: Case) -> Iterator[Problem]:
    """Yield a warning for recipe limits that accept objects far beside their place."""
    if case.recipe is None or files.recipe is None:
        return
    widths_px = {
        sensor.name: sensor.intrinsics.width_px
        for sensor in case.vehicles["real"].sensors
        if isinstance(sensor, CameraSetup | DepthSetup)
    }
    for combination in case.recipe.combinations:
        limit_px = combination.budget.max_registration_error_px
        width_px = widths_px.get(combination.sensor.name)
        if limit_px is None or width_px is None or limit_px <= _WIDE_SHARE * width_px:
            continue
        message = (
            f"accepts virtual objects {limit_px:g} px beside their place, in images of "
            f"'{combination.sensor.name}' that are {width_px} px wide: set at most "
            f"{_WIDE_SHARE * width_px:g}, or remove the key for the default"
        )
        yield files.recipe.problem((*combination.path, "max_registration_error_px"), message)


def nothing_isolated_warnings(files: CaseFiles, case: Case) -> Iterator[Problem]:
    """Yield a warning for each combination whose isolated objects the virtual world all lacks."""
    if case.recipe is None or files.recipe is None:
        return
    there = set(case.world.scene("wil", "Wv").names)
    for combination in case.recipe.combinations:
        named = combination.isolated()
        if named and not named & there:
            names = ", ".join(f"'{name}'" for name in sorted(named))
            message = f"isolates {names} alone, and Wv in mode wil has nothing of it"
            yield files.recipe.problem(
                (*combination.path, "filter"), f"{message}: nothing is mixed in", key=True
            )


def nothing_real_warnings(files: CaseFiles, case: Case) -> Iterator[Problem]:
    """Yield a warning for each combination of a sensor that shows a world in which nothing is real.

    The flight shows then what a simulation shows: the autonomy perceives the twin's world alone.
    """
    if case.recipe is None or files.recipe is None:
        return
    for combination in case.recipe.combinations:
        filtered = {
            side
            for step in combination.steps
            if step.kind.stage == "filter"
            for side in step.parameters.sides()
        }
        covers = combination.merge.parameters.covers_with() == "twin" and "twin" not in filtered
        if covers and traits_named(combination.sensor.kind).visibility:
            message = f"the mixture of '{combination.sensor.name}' is the twin's reading alone"
            yield files.recipe.problem(
                (*combination.path, "merge"), f"{message}: nothing real is in it", key=True
            )


def unmixed_object_warnings(files: CaseFiles, case: Case) -> Iterator[Problem]:
    """Yield a warning for virtual objects that no combination of the recipe mixes in.

    Only where every combination isolates other objects by name: which objects a colour or a region
    keeps is known in flight only. A combination with `shows` states its intent and gets a warning
    for objects alone that the goal or a required oracle names.
    """
    if case.recipe is None or files.recipe is None:
        return
    things = virtual_only_objects(case.world.scene("wil", "W"), case.world.scene("wil", "Wv"))
    isolating = [
        combination
        for combination in case.recipe.combinations
        if traits_named(combination.sensor.kind).visibility
    ]
    yield from _named_and_not_shown(
        files.recipe, isolating, named_objects(case) & {*things.values()}
    )
    there = set(case.world.scene("wil", "Wv").names)
    if not isolating or not all(_leaves_out(one, there) for one in isolating):
        return
    mixed = {name for one in isolating for name in one.isolated()}
    named = named_objects(case)
    for name in things.values():
        if name not in mixed:
            why = ", and the goal or a required oracle names it" if name in named else ""
            message = (
                f"no combination mixes in '{name}', which exists in the virtual world only{why}"
            )
            path = (*isolating[0].path, "filter")
            yield files.recipe.problem(
                path, f"{message} (list the intended objects in `shows`)", key=True
            )


def unmixed_sensor_warnings(files: CaseFiles, case: Case) -> Iterator[Problem]:
    """Yield a warning for each sensor that shows a world and that no combination mixes.

    An autonomy gets the real one's readings as they are, in which nothing virtual is.
    """
    if case.recipe is None or files.recipe is None:
        return
    if not virtual_only_objects(case.world.scene("wil", "W"), case.world.scene("wil", "Wv")):
        return
    mixed = case.recipe.sensors_for("real")
    for sensor in case.vehicles["real"].sensors if mixed else ():
        if sensor.name not in mixed and traits_named(sensor.kind).visibility:
            message = f"mixes no '{sensor.name}' for 'real': it is the real one, without what is"
            yield files.recipe.problem(("combine",), f"{message} virtual", key=True)


def _named_and_not_shown(
    recipe: Document, combinations: list[Combination], named: set[str]
) -> Iterator[Problem]:
    """Yield a warning for objects that goal or oracle names, and `shows` leaves out everywhere."""
    if not combinations or any(combination.shows is None for combination in combinations):
        return
    shown = {name for combination in combinations for name in combination.shows or ()}
    for name in sorted(named - shown):
        message = f"`shows` leaves out '{name}', which the goal or a required oracle names"
        yield recipe.problem(
            (*combinations[0].path, "shows"), f"{message}: its images are not checked"
        )


def _leaves_out(combination: Combination, there: set[str]) -> bool:
    """Return whether a combination isolates by name what is in the virtual world, no `shows`."""
    return combination.shows is None and bool(combination.isolated() & there)
