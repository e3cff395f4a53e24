"""Warnings of virtual objects that no mixture of a recipe can show, found without a flight; pure.

Each object is held before the twin's camera in its colour, in light and shadow, near and far, over
a real image of other pixels: where the mixture stays the real image, nothing can show it.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import product

import numpy as np

from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.campaigns.setup.case_setup import Case
from wil_campaign.campaigns.setup.named_objects import named_objects
from wil_campaign.campaigns.values.sensor_setups import CameraSetup
from wil_campaign.foundation.files.documents import Problem
from wil_campaign.recipes.model.recipe import Combination, Recipe, StepUse
from wil_campaign.recipes.pipeline.sight_check import is_foreseeable, needs_depth, shows_twin
from wil_campaign.recipes.working import SIDES, Side
from wil_campaign.vehicles.readings import CameraReading
from wil_campaign.vehicles.readings.kinds import traits_named
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.scene.colors import Rgb
from wil_campaign.worlds.scene.scene import SceneObject, virtual_only_objects

_LIGHTS = (1.0, 0.7, 0.45, 0.25)
"""Shares of an object's colour, in light and in shadow."""
_DISTANCES_M = (2.0, 0.7, 6.0, 20.0)
_FAR_M = 1000.0
_SIZELESS = frozenset(
    {"resize", "register", "isolate_color", "isolate_objects", "isolate_depth", "overlay"}
)
"""Steps that do the same to an image of one colour whatever its size: a small one is tried."""
_SMALL = Intrinsics.from_fov(8, 8, math.radians(60.0))


def hidden_object_warnings(files: CaseFiles, case: Case) -> Iterator[Problem]:
    """Yield a warning for virtual objects that no mixture can show, wherever they stand.

    Of those that the goal, a required oracle or `shows` names; without any, where none of the
    world's can be shown. Nothing where the steps cannot be tried without a flight: code of users,
    other sensors than cameras, images of simulators.
    """
    recipe, world = case.recipe, case.world.scene("wil", "Wv")
    if recipe is None or files.recipe is None:
        return
    showing = [one for one in recipe.combinations if traits_named(one.sensor.kind).visibility]
    things = set(virtual_only_objects(case.world.scene("wil", "W"), world).values())
    named = named_objects(case) | {name for one in showing for name in one.shows or ()}
    if showing and all(one.isolated() for one in showing):
        things &= {name for one in showing for name in one.isolated()}  # others: `unmixed_objects`
    if not showing or not all(_is_tried(case, one) for one in showing):
        return
    hidden = {name for name in things if not _is_shown(case, recipe, showing, world[name])}
    if not hidden & named and (named & things or hidden != things):
        return
    for name in sorted(hidden & named or hidden):
        bare = [replace(one, steps=_transforms(one)) for one in showing]
        if _is_shown(case, recipe, bare, world[name]):
            colors = ", ".join(f"#{r:02x}{g:02x}{b:02x}" for r, g, b in _colors(world[name]))
            why, key = f"no filter keeps its colour ({colors})", "filter"
        else:
            why, key = "the merge takes nothing of the twin's image", "merge"
        message = f"no mixture can show '{name}': {why}, and the autonomy never perceives it"
        yield files.recipe.problem((*showing[0].path, key), message, key=True)


def _transforms(combination: Combination) -> tuple[StepUse, ...]:
    return tuple(step for step in combination.steps if step.kind.stage == "transform")


def _is_tried(case: Case, combination: Combination) -> bool:
    """Return whether a combination can be tried without a flight: rendered cameras, known steps."""
    cameras = _cameras(case, combination)
    return (
        len(cameras) == len(SIDES)
        and cameras["twin"].source is None
        and is_foreseeable(combination)
    )


def _cameras(case: Case, combination: Combination) -> dict[Side, CameraSetup]:
    return {
        side: sensor
        for side in SIDES
        if side in case.vehicles
        for sensor in case.vehicles[side].sensors
        if isinstance(sensor, CameraSetup) and sensor.name == combination.sensor.name
    }


def _is_shown(case: Case, recipe: Recipe, showing: list[Combination], thing: SceneObject) -> bool:
    """Return whether any mixture shows something of an object in some light, at some distance."""
    looks = list(product(_LIGHTS, _colors(thing), _DISTANCES_M))
    is_textured = any(material.texture is not None for material in thing.shape.mesh.materials)
    return is_textured or any(
        shows_twin(
            combination,
            _pair(_cameras(case, combination), combination, thing, look),
            object_ids=case.world.object_ids,
            folder=recipe.document.path.parent,
        )
        for look in looks
        for combination in showing
    )


def _colors(thing: SceneObject) -> list[Rgb]:
    return list(dict.fromkeys(material.rgb for material in thing.shape.mesh.materials))


def _pair(
    cameras: Mapping[Side, CameraSetup],
    combination: Combination,
    thing: SceneObject,
    look: tuple[float, Rgb, float],
) -> dict[Side, CameraReading]:
    """Return a black real image of nothing, and a twin's image full of an object."""
    light, rgb, distance_m = look
    bgr = tuple(max(1, round(light * part)) for part in reversed(rgb))

    steps = (*combination.steps, combination.merge)
    is_sizeless = all(step.kind.name in _SIZELESS for step in steps)
    is_small = is_sizeless and cameras["real"].intrinsics == cameras["twin"].intrinsics

    def image(side: Side, color: tuple[int, ...], far_m: float, object_id: int) -> CameraReading:
        lens = _SMALL if is_small else cameras[side].intrinsics
        size = (lens.height_px, lens.width_px)
        has_depth = cameras[side].source is not None or needs_depth(combination, side)
        return CameraReading(
            *(0.0, 0.0, 0, side),
            np.full((*size, 3), color, np.uint8),
            lens,
            depth_m=np.full(size, far_m, np.float32) if has_depth else None,
            object_ids=np.full(size, object_id, np.uint8),
            sensor=combination.sensor.name,
        )

    twin = image("twin", bgr, distance_m, thing.object_id)
    return {"real": image("real", (0, 0, 0), _FAR_M, 0), "twin": twin}
