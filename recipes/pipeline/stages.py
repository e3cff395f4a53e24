"""Compiled steps: an operator for each side, and the step's place in the recipe for errors."""

import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

from wil_campaign.foundation.files.documents import Document
from wil_campaign.foundation.files.problems import printable_problem
from wil_campaign.foundation.files.user_modules import user_file_path
from wil_campaign.installed_plugins import plugin_of_module, whose_fault_text
from wil_campaign.recipes.model.recipe import Combination, StepUse
from wil_campaign.recipes.model.registry import OWN_STEP, StepContext, StepType
from wil_campaign.recipes.operations.checked_results import (
    BadResultError,
    checked_merge,
    checked_side,
    copied_side,
)
from wil_campaign.recipes.working import (
    SIDES,
    AnyMasked,
    Built,
    CannotMixError,
    Merge,
    Need,
    Operator,
    PoseRequest,
    Side,
    Sides,
    StepError,
    TimedOperator,
)
from wil_campaign.vehicles.readings import Reading, sensor_type_of

Stopwatch = Callable[[], float]


@dataclass(frozen=True, slots=True)
class StageView:
    """The result of one stage. side: None for a merge. work: valid until the next frame."""

    name: str
    side: Side | None
    work: AnyMasked


Observer = Callable[[StageView], None]


@dataclass(frozen=True, slots=True)
class StepPlace:
    """The place of a stage's step in its recipe, and its name in messages.

    plugin: whose step it is; empty for the program's, and for a user's own.
    """

    file: str
    line: int
    label: str
    plugin: str

    def failed(self, error: BaseException, frame: int) -> StepError:
        """Return the error of a stage's step with its place."""
        detail = _error_text(error) + whose_fault_text(self.plugin)
        return StepError(
            file=self.file, line=self.line, step=self.label, frame=frame, detail=detail
        )


def _error_text(error: BaseException) -> str:
    """Return type, message and place of an exception raised in a stage's step.

    The place is the innermost line of the user's own code, which may have called a library.
    """
    try:
        message = printable_problem(" ".join(str(error).split()))
    except Exception:  # noqa: BLE001 - __str__ of the user's code may raise anything
        message = "(its message cannot be shown)"
    if isinstance(error, BadResultError):
        return message
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if user_file_path(frame.filename) is not None] or frames
    where = f" ({Path(own[-1].filename).name} line {own[-1].lineno})" if own else ""
    return f"{type(error).__name__}: {message}{where}"


@dataclass(frozen=True, slots=True)
class Stage:
    """A compiled transform or filter step; one operator per side, since each has buffers."""

    name: str
    sides: tuple[Side, ...]
    operators: Mapping[Side, Operator]
    place: StepPlace
    kind: StepType

    def apply(self, side: Side, sides: Sides, frame: int) -> AnyMasked:
        """Return one side after the stage. Raises CannotMixError, or StepError for other faults."""
        other: Side = "twin" if side == "real" else "real"
        try:
            operator, work, beside = self.operators[side], sides[side], sides.get(other)
            if not _is_checked(self.kind):
                return operator(work, beside)
            made = operator(copied_side(work), None if beside is None else copied_side(beside))
            of = sensor_type_of(work.reading)
            return checked_side(made, work, self.kind.gives.get(of, of))
        except (CannotMixError, KeyboardInterrupt):
            raise
        except BaseException as error:  # SystemExit and CancelledError of a user's step, too
            raise self.place.failed(error, frame) from error

    def offer(self, side: Side, reading: Reading) -> Reading | None:
        """Offer a reading to a stage that selects by time; return the input of the next stage."""
        operator = self.operators.get(side)
        return operator.offer(reading) if isinstance(operator, TimedOperator) else reading


@dataclass(frozen=True, slots=True)
class MergeStage:
    """The compiled merge stage, and its place in the recipe."""

    name: str
    merge: Merge
    place: StepPlace
    kind: StepType

    def apply(self, sides: Sides, frame: int) -> Reading:
        """Return the merged reading. Raises CannotMixError, or StepError for any other fault."""
        try:
            if not _is_checked(self.kind):
                return self.merge(sides)
            made = self.merge({side: copied_side(work) for side, work in sides.items()})
            return checked_merge(made, sensor_type_of(sides["real"].reading))
        except (CannotMixError, KeyboardInterrupt):
            raise
        except BaseException as error:  # SystemExit and CancelledError of a user's step, too
            raise self.place.failed(error, frame) from error


@dataclass(frozen=True, slots=True)
class CompiledStages:
    """A combination's compiled stages. needs: what each side's readings must carry."""

    stages: tuple[Stage, ...]
    merging: MergeStage
    pose_request: PoseRequest | None
    needs: Mapping[Side, frozenset[Need]]


def compile_stages(
    combination: Combination, context: StepContext, document: Document
) -> CompiledStages:
    """Return the stages of a combination, built from its steps.

    Raises ValueError for an unknown object, StepError for a step of the user's that cannot be made.
    """
    stages: list[Stage] = []
    request: PoseRequest | None = None
    needs: dict[Side, frozenset[Need]] = {
        side: combination.merge.parameters.needed() for side in SIDES
    }
    for step in combination.steps:
        sides = step.parameters.sides()
        place = _place(step, document)
        built = {
            side: _build_operator(step, replace(context, side=side), place)
            for side in sides or SIDES[1:]
        }
        for side in built:
            needs[side] |= step.parameters.needed()
        first = next(iter(built.values()))
        if isinstance(first, PoseRequest):
            request = first
        else:
            operators = cast("Mapping[Side, Operator]", built)
            stages.append(Stage(step.label, sides, operators, place, step.kind))
    step, place = combination.merge, _place(combination.merge, document)
    merge = cast("Merge", _build_operator(step, context, place))
    merging = MergeStage(step.label, merge, place, step.kind)
    return CompiledStages(tuple(stages), merging, request, needs)


def _build_operator(step: StepUse, context: StepContext, place: StepPlace) -> Built:
    """Build a stage's operator; code of others that raises becomes a StepError."""
    try:
        built: Built = step.kind.build(step.parameters, context)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        if step.kind.is_of_others:
            raise place.failed(error, 0) from error
        raise
    return built


def _is_checked(kind: StepType) -> bool:
    """Return whether a stage checks what its step returns: `use` does so itself."""
    return kind.is_of_others and kind.name != OWN_STEP


def _place(step: StepUse, document: Document) -> StepPlace:
    place = document.problem(step.path, "", key=True)  # a case may override it, in its own file
    plugin = plugin_of_module(step.kind.build.__module__)
    return StepPlace(place.file, place.line, step.label, plugin)
