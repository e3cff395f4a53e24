"""Whether a combination can show what a twin's sensor sees, known without a flight; pure."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path as FilePath
from typing import cast

import numpy as np

from wil_campaign.recipes.model.recipe import Combination
from wil_campaign.recipes.model.registry import StepContext
from wil_campaign.recipes.operations.masks import is_kept
from wil_campaign.recipes.working import (
    SIDES,
    AnyMasked,
    CannotMixError,
    Masked,
    Merge,
    Operator,
    PoseRequest,
    Side,
)
from wil_campaign.vehicles.readings import CameraReading

_KNOWN = frozenset(
    {
        *("resize", "register", "crop", "camera_model"),
        *("isolate_color", "isolate_objects", "isolate_region", "isolate_depth", "matte"),
        *("overlay", "replace"),
    }
)
"""Steps whose result follows from one image alone, without code or files of users."""
_CONDITION = "when"


def is_foreseeable(combination: Combination) -> bool:
    """Return whether `shows_twin` of uniform images tells what other images come to.

    It does not where a filter or a condition looks at the real image.
    """
    return combination.sensor.kind == "camera" and all(
        step.kind.name in _KNOWN
        and getattr(step.parameters, _CONDITION, None) is None
        and not (step.kind.stage == "filter" and "real" in step.parameters.sides())
        for step in (*combination.steps, combination.merge)
    )


def needs_depth(combination: Combination, side: Side) -> bool:
    """Return whether the rendered images of a side have depth, for a step that needs it."""
    steps = [step for step in combination.steps if side in step.parameters.sides()]
    return any("depth" in step.parameters.needed() for step in (*steps, combination.merge))


def shows_twin(
    combination: Combination,
    pair: Mapping[Side, CameraReading],
    *,
    object_ids: Mapping[str, int],
    folder: FilePath,
) -> bool:
    """Return whether anything of the twin's image is in the mixture of two images.

    pair: the twin's differs from the real one in every pixel. folder: as of `shape_mismatch`.
    A mixture that a step refuses counts as one that shows it: that has a check of its own.
    """
    context = StepContext(object_ids, folder)
    sides: dict[Side, AnyMasked] = {side: Masked(reading) for side, reading in pair.items()}
    try:
        for step in combination.steps:
            for side in step.parameters.sides() or SIDES[1:]:
                built = step.kind.build(step.parameters, replace(context, side=side))
                if not isinstance(built, PoseRequest):
                    other = sides["twin" if side == "real" else "real"]
                    sides[side] = cast("Operator", built)(sides[side], other)
        merge = cast("Merge", combination.merge.kind.build(combination.merge.parameters, context))
        if not is_kept(sides["twin"]):
            return False
        mixed = cast("CameraReading", merge(sides)).image_bgr
        alone = cast("CameraReading", sides["real"].reading).image_bgr
    except CannotMixError:
        return True
    return mixed.shape != alone.shape or bool(np.any(mixed != alone))
