"""Steps of the user's own: `{use: file.py:function, with: {...}}`, in any stage."""

import inspect
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any, cast

from pydantic import Field, JsonValue

from wil_campaign.foundation.files.references import BadReferenceError, load_reference
from wil_campaign.recipes.model.registry import (
    EVERY_SENSOR,
    OWN_STEP,
    ParameterFault,
    SidedParameters,
    StepContext,
    StepParameters,
    step,
)
from wil_campaign.recipes.operations.checked_results import (
    checked_merge,
    checked_side,
    copied_side,
)
from wil_campaign.recipes.working import AnyMasked, Merge, Operator, Sides
from wil_campaign.vehicles.readings import Reading, sensor_type_of


def _load_function(use: str, folder: FilePath) -> Callable[..., Any]:
    """Return the function or class of a user's own step. Raises BadReferenceError."""
    found = load_reference(use, folder, beside="the recipe")
    if not callable(found):
        raise BadReferenceError(f"'{use}' is neither a function nor a class")
    return found


def _function_faults(
    use: str, given: dict[str, JsonValue], folder: FilePath, arguments: tuple[str, ...]
) -> tuple[ParameterFault, ...]:
    """Return the faults of a user's own step: a missing reference, or a wrong signature."""
    try:
        found = _load_function(use, folder)
    except BadReferenceError as error:
        return (ParameterFault(("use",), str(error), error.suggestion),)
    try:
        if inspect.isclass(found):
            inspect.signature(found).bind(**given)
            inspect.signature(found.__call__).bind(None, *arguments)
        else:
            inspect.signature(found).bind(*arguments, **given)
    except (TypeError, ValueError) as error:
        wanted = ", ".join(arguments)
        message = f"'{use}' cannot be called with ({wanted}) and the arguments in 'with': {error}"
        return (ParameterFault(("with",) if given else ("use",), message),)
    return ()


def _prepare_function(
    use: str, given: dict[str, JsonValue], context: StepContext
) -> Callable[..., Any]:
    """Return the callable of a user's own step: the function, or an instance of the class."""
    found = _load_function(use, context.folder)
    if inspect.isclass(found):
        return cast("Callable[..., Any]", found(**given))
    return lambda *arguments: found(*arguments, **given)


class UseParameters(SidedParameters):
    """use: file.py:function, the file relative to the recipe. with: named arguments for it."""

    use: str
    with_: dict[str, JsonValue] = Field(default_factory=dict, alias="with")

    def label(self) -> str:
        """Return the name of the user's own step."""
        return self.use

    def reference(self) -> str:
        """Return the user's function or class."""
        return self.use

    def faults(self, folder: FilePath) -> tuple[ParameterFault, ...]:
        """Return why the user's own step cannot be used."""
        return _function_faults(self.use, self.with_, folder, ("work", "other"))


def use(parameters: UseParameters, context: StepContext) -> Operator:
    """Call a function of the user's own: (work, other, **with) that returns a reading or a Masked.

    work, other: wil_campaign.api.Masked, of this side and of the other (None when it is missing).
    They are copies, which the step may write into. The returned reading must be valid and of the
    same type; a reading without a Masked keeps the mask.
    A class is instantiated once, with the arguments in `with`, and its instance is called.
    """
    called = _prepare_function(parameters.use, parameters.with_, context)

    def operator(work: AnyMasked, other: AnyMasked | None) -> AnyMasked:
        made = called(copied_side(work), None if other is None else copied_side(other))
        return checked_side(made, work, sensor_type_of(work.reading))

    return operator


class UseMergeParameters(StepParameters):
    """use: file.py:function, the file relative to the recipe. with: named arguments for it."""

    use: str
    with_: dict[str, JsonValue] = Field(default_factory=dict, alias="with")

    def label(self) -> str:
        """Return the name of the user's own merge."""
        return self.use

    def reference(self) -> str:
        """Return the user's function or class."""
        return self.use

    def faults(self, folder: FilePath) -> tuple[ParameterFault, ...]:
        """Return why the user's own merge cannot be used."""
        return _function_faults(self.use, self.with_, folder, ("sides",))


def use_merge(parameters: UseMergeParameters, context: StepContext) -> Merge:
    """Call a function of the user's own: (sides, **with) that returns the mixed reading.

    sides: a mapping of "real" and "twin" to wil_campaign.api.Masked, copies as of `use`; "twin" is
    missing when there is no reading of it to mix.
    """
    called = _prepare_function(parameters.use, parameters.with_, context)

    def merge(sides: Sides) -> Reading:
        made = called({side: copied_side(work) for side, work in sides.items()})
        return checked_merge(made, sensor_type_of(sides["real"].reading))

    return merge


OWN_STEPS = (
    step(OWN_STEP, stage="transform", sensors=EVERY_SENSOR, parameters=UseParameters)(use),
    step(OWN_STEP, stage="filter", sensors=EVERY_SENSOR, parameters=UseParameters)(use),
    step(OWN_STEP, stage="merge", sensors=EVERY_SENSOR, parameters=UseMergeParameters)(use_merge),
)
"""The step `use` of each stage."""
