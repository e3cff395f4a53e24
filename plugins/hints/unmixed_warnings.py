"""Warnings of objects and sensors that a recipe leaves unmixed, probably unintended; pure."""

from collections.abc import Iterator

from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.campaigns.setup.case_setup import Case
from wil_campaign.campaigns.setup.named_objects import named_objects
from wil_campaign.foundation.files.documents import Document, Problem
from wil_campaign.recipes.model.recipe import Combination
from wil_campaign.vehicles.readings.kinds import traits_named
from wil_campaign.worlds.scene.scene import virtual_only_objects


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
    mixed, real = case.recipe.sensors_for("real"), case.vehicles.get("real")
    for sensor in real.sensors if mixed and real is not None else ():
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
