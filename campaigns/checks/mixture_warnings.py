"""Warnings of mixtures that show less, or check less, than is probably meant; pure."""

from collections.abc import Iterator

from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.campaigns.setup.case_setup import Case
from wil_campaign.campaigns.values.sensor_setups import CameraSetup, DepthSetup
from wil_campaign.foundation.files.documents import Problem
from wil_campaign.vehicles.readings.kinds import traits_named

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
