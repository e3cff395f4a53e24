"""Sizes of readings in a combination: whether they pass its steps, and that of the mixture; pure.

It runs the operators of the flight on blank readings, so that both agree on what fits.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path as FilePath
from typing import Any, TypeVar, cast

from wil_campaign.foundation.files.documents import Path
from wil_campaign.recipes.model.recipe import Combination, StepUse
from wil_campaign.recipes.model.registry import StepContext
from wil_campaign.recipes.working import (
    SIDES,
    AnyMasked,
    CannotMixError,
    Masked,
    Merge,
    Operator,
    Side,
)
from wil_campaign.vehicles.readings import Reading
from wil_campaign.vehicles.readings.kinds import traits_named

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class ShapeMismatch:
    """A step that does not accept the size of its input. path: in the recipe's document."""

    path: Path
    message: str


def blank_reading_of(sensor: Any, side: Side) -> Reading | None:
    """Return an empty reading as large as those of a sensor, by its setup; None without a size."""
    blank = traits_named(sensor.kind).blank
    return None if blank is None else blank(sensor, side)


def shape_mismatch(
    combination: Combination, blank: Mapping[Side, Reading], folder: FilePath
) -> ShapeMismatch | None:
    """Return the first step, or the merge, that refuses readings of these sizes; None for none.

    blank: a reading of each side, of which only the shape counts. folder: to which files in the
    recipe are relative. Steps that keep the shape are skipped. With a step of others, or a
    conversion into another type, the shape is unknown and nothing is checked.
    """
    steps = (*combination.steps, combination.merge)
    if _is_converted(combination) or any(step.kind.is_of_others for step in steps):
        return None
    sides = _reshaped(combination, blank, folder)
    merged = sides if isinstance(sides, ShapeMismatch) else _merged(combination, sides, folder)
    return merged if isinstance(merged, ShapeMismatch) else None


def blank_mixture(
    combination: Combination, blank: Mapping[Side, Reading], folder: FilePath
) -> Reading:
    """Return a reading as large as the mixtures of readings of these sizes.

    blank, folder: as of `shape_mismatch`. Steps of others count as keeping the size; where
    that is not enough to know the mixture's, it is that of the real reading.
    """
    if _is_converted(combination):
        return blank["real"]
    sides = _reshaped(combination, blank, folder)
    if isinstance(sides, ShapeMismatch):
        return blank["real"]
    real: Reading = sides["real"].reading
    if combination.merge.kind.is_of_others:
        return real
    merged = _merged(combination, sides, folder)
    return real if merged is None or isinstance(merged, ShapeMismatch) else merged


def _is_converted(combination: Combination) -> bool:
    """Return whether a step converts a side's readings into another type, of unknown shape."""
    sensor = combination.sensor
    return any(sensor.kind_of(side) != sensor.kind for side in SIDES)


def _reshaped(
    combination: Combination, blank: Mapping[Side, Reading], folder: FilePath
) -> dict[Side, AnyMasked] | ShapeMismatch:
    """Return both sides after the combination's steps that change shapes; or the mismatch."""
    sides: dict[Side, AnyMasked] = {side: Masked(one) for side, one in blank.items()}
    for step in combination.steps:
        if step.parameters.reshapes and not step.kind.is_of_others:
            mismatch = _reshape(step, sides, StepContext(folder=folder))
            if mismatch is not None:
                return mismatch
    return sides


def _merged(
    combination: Combination, sides: Mapping[Side, AnyMasked], folder: FilePath
) -> Reading | ShapeMismatch | None:
    """Return the merge of both sides, its mismatch, or None where blank ones have no result."""
    step = combination.merge
    merge = cast("Merge", step.kind.build(step.parameters, StepContext(folder=folder)))
    return _attempt(step, partial(merge, sides))


def _reshape(
    step: StepUse, sides: dict[Side, AnyMasked], context: StepContext
) -> ShapeMismatch | None:
    """Replace each side of a step by the step's result; return a mismatch, if any."""
    for side in step.parameters.sides():
        built = step.kind.build(step.parameters, replace(context, side=side))
        other = sides["twin" if side == "real" else "real"]
        reshaped = _attempt(step, partial(cast("Operator", built), sides[side], other))
        if isinstance(reshaped, ShapeMismatch):
            return reshaped
        if reshaped is not None:
            sides[side] = reshaped
    return None


def _attempt(step: StepUse, work: Callable[[], T]) -> T | ShapeMismatch | None:
    """Return the result of a step, its mismatch, or None where a blank reading has no result."""
    try:
        return work()
    except CannotMixError as error:
        # A blank reading may lack depth or ids, which is no mismatch.
        return ShapeMismatch(step.path, str(error)) if error.reason == "mismatch" else None
