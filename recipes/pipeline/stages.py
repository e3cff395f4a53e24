"""Compiled steps: an operator for each side, and the step's place in the recipe for errors."""

import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

from wil_campaign.foundation.files.documents import Document
from wil_campaign.foundation.files.problems import printable_problem
from wil_campaign.foundation.files.user_modules import user_file_path
from wil_campaign.recipes.model.recipe import Combination, StepUse
from wil_campaign.recipes.model.registry import OWN_STEP, StepContext
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
from wil_campaign.vehicles.readings import Reading

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
    """The place of a stage's step in its recipe, and its name in messages."""

    file: str
    line: int
    label: str

    def failed(self, error: BaseException, frame: int) -> StepError:
        """Return the error of a stage's step with its place."""
        return StepError(
            file=self.file, line=self.line, step=self.label, frame=frame, detail=_error_text(error)
        )


def _error_text(error: BaseException) -> str:
    """Return type, message and place of an exception raised in a stage's step.

    The place is the innermost line of the user's own code, which may have called a library.
    """
    try:
        message = printable_problem(" ".join(str(error).split()))
    except Exception:  # noqa: BLE001 - __str__ of the user's code may raise anything
        message = "(its message cannot be shown)"
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

    def apply(self, side: Side, sides: Sides, frame: int) -> AnyMasked:
        """Return one side after the stage. Raises CannotMixError, or StepError for other faults."""
        other: Side = "twin" if side == "real" else "real"
        try:
            return self.operators[side](sides[side], sides.get(other))
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

    def apply(self, sides: Sides, frame: int) -> Reading:
        """Return the merged reading. Raises CannotMixError, or StepError for any other fault."""
        try:
            return self.merge(sides)
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
            stages.append(Stage(step.label, sides, operators, place))
    step, place = combination.merge, _place(combination.merge, document)
    merging = MergeStage(step.label, cast("Merge", _build_operator(step, context, place)), place)
    return CompiledStages(tuple(stages), merging, request, needs)


def _build_operator(step: StepUse, context: StepContext, place: StepPlace) -> Built:
    """Build a stage's operator; a user class that raises becomes a StepError."""
    try:
        built: Built = step.kind.build(step.parameters, context)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        if step.kind.name == OWN_STEP:
            raise place.failed(error, 0) from error
        raise
    return built


def _place(step: StepUse, document: Document) -> StepPlace:
    place = document.problem(step.path, "", key=True)  # a case may override it, in its own file
    return StepPlace(place.file, place.line, step.label)
