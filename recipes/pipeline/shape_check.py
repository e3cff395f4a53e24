"""Check that readings of given sizes pass the steps of a combination and fit each other; pure.

It runs the operators of the flight on blank readings, so that both agree on what fits.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path as FilePath
from typing import TypeVar, cast

from recipes.model.recipe import Combination, Step
from recipes.model.registry import OWN_STEP, Context
from recipes.working import AnyMasked, CannotMixError, Masked, Merge, Operator, Side
from vehicles.readings import Reading
from worlds.files.documents import Path

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class ShapeMismatch:
    """A step that does not accept the size of its input. path: in the recipe's document."""

    path: Path
    message: str


def shape_mismatch(
    combination: Combination, blank: Mapping[Side, Reading], folder: FilePath
) -> ShapeMismatch | None:
    """Return the first step, or the merge, that refuses readings of these sizes; None for none.

    blank: a reading of each side, of which only the shape counts. folder: to which files in the
    recipe are relative. Steps that keep the shape are skipped. With a step of the user's own, or a
    conversion into another type, the shape is unknown and nothing is checked.
    """
    steps = (*combination.steps, combination.merge)
    sensor = combination.sensor
    converted = any(sensor.kind_of(side) != sensor.kind for side in blank)
    if converted or any(step.kind.name == OWN_STEP for step in steps):
        return None
    context = Context(folder=folder)
    sides: dict[Side, AnyMasked] = {side: Masked(one) for side, one in blank.items()}
    for step in combination.steps:
        if step.parameters.reshapes and (mismatch := _reshape(step, sides, context)) is not None:
            return mismatch
    merge = cast("Merge", combination.merge.kind.build(combination.merge.parameters, context))
    merged = _attempt(combination.merge, partial(merge, sides))
    return merged if isinstance(merged, ShapeMismatch) else None


def _reshape(step: Step, sides: dict[Side, AnyMasked], context: Context) -> ShapeMismatch | None:
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


def _attempt(step: Step, work: Callable[[], T]) -> T | ShapeMismatch | None:
    """Return the result of a step, its mismatch, or None where a blank reading has no result."""
    try:
        return work()
    except CannotMixError as error:
        # A blank reading may lack depth or ids, which is no mismatch.
        return ShapeMismatch(step.path, str(error)) if error.reason == "mismatch" else None
