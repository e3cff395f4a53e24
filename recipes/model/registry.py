"""The steps that a recipe can name: a decorator and a dict.

A step is a function that builds an operator from its parameters; the first line of its docstring
is what people read in the listing.
"""

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import Any, ClassVar, Literal, TypeVar

from pydantic import model_validator

from recipes.working import Built, Need, Side
from worlds.files.documents import Part, Path, closest

Stage = Literal["transform", "filter", "merge"]
OWN_STEP = "use"
"""Name of the step that calls the user's code, in every stage."""
STAGES: tuple[Stage, ...] = ("transform", "filter", "merge")


@dataclass(frozen=True, slots=True)
class ParameterFault:
    """What is wrong with a parameter in view of other files. path: in the step's parameters."""

    path: Path
    message: str
    suggestion: str = ""


class StepParameters(Part):
    """What a step may be given in a recipe; unknown keys are refused.

    shorthand: the parameter that a value stands for which is no mapping: `resize: real`.
    needs: what the step needs of a side's readings beside their values. tolerates: which faults of
    a reading (vehicles.readings.checks) the step is there to mend. timed: whether the step chooses
    among a side's readings by time; it then stands before all others of that side.
    """

    shorthand: ClassVar[str] = ""
    needs: ClassVar[frozenset[Need]] = frozenset()
    tolerates: ClassVar[frozenset[str]] = frozenset()
    timed: ClassVar[bool] = False

    @model_validator(mode="before")
    @classmethod
    def _expand(cls, given: object) -> object:
        if cls.shorthand and given is not None and not isinstance(given, dict):
            return {cls.shorthand: given}
        return given

    def sides(self) -> tuple[Side, ...]:
        """Return the sides that the step works on; a merge works on none of its own."""
        return ()

    def needed(self) -> frozenset[Need]:
        """Return what the step needs, as it is used."""
        return self.needs

    def label(self) -> str:
        """Return what people call the step where its name does not tell; "" for its name."""
        return ""

    def refuses(self, kind: str) -> str:
        """Return why the step, as used, does not work on a sensor of this type; "" if it does."""
        del kind
        return ""

    def faults(self, folder: FilePath) -> tuple[ParameterFault, ...]:
        """Return what is wrong with files that are named; they are relative to a folder."""
        del folder
        return ()

    def reference(self) -> str:
        """Return the user's code that the step runs, as file.py:name; "" for a step of ours."""
        return ""

    def objects(self) -> tuple[tuple[Path, str], ...]:
        """Return the objects of the world that the step names, each with its path in here."""
        return ()


class SidedParameters(StepParameters):
    """Parameters of a transform or filter. on: the side it works on, usually the twin's."""

    on: Literal["real", "twin", "both"] = "twin"

    def sides(self) -> tuple[Side, ...]:
        """Return the sides that the step works on."""
        return ("real", "twin") if self.on == "both" else (self.on,)


@dataclass(frozen=True, slots=True)
class Context:
    """What is known of the run when a recipe is compiled.

    object_ids: ids of the twin's world. folder: what files in the recipe are relative to. side:
    the one that an operator is built for; None for a merge.
    """

    object_ids: Mapping[str, int] = field(default_factory=dict)
    folder: FilePath = FilePath()
    side: Side | None = None


@dataclass(frozen=True, slots=True)
class StepType:
    """A kind of step.

    sensors: the types that it works on. gives: the type that it turns one of these into, where
    that is another. summary: one sentence.
    """

    name: str
    stage: Stage
    sensors: tuple[str, ...]
    parameters: type[StepParameters]
    summary: str
    build: Callable[[Any, Context], Built]
    gives: Mapping[str, str] = field(default_factory=dict)


class DuplicateStepError(ValueError):
    """Two steps of one name."""


P = TypeVar("P", bound=StepParameters)
B = TypeVar("B", bound=Built)

_TYPES: dict[tuple[str, Stage], StepType] = {}


def step(
    name: str,
    *,
    stage: Stage,
    sensors: tuple[str, ...],
    parameters: type[P],
    gives: Mapping[str, str] | None = None,
) -> Callable[[Callable[[P, Context], B]], Callable[[P, Context], B]]:
    """Register a function as the step of this name. Raises DuplicateStepError on a second one."""

    def register(build: Callable[[P, Context], B]) -> Callable[[P, Context], B]:
        if (name, stage) in _TYPES:
            raise DuplicateStepError(f"step '{name}' is registered already as a {stage}")
        summary = (build.__doc__ or "").partition("\n")[0].strip()
        kind = StepType(name, stage, sensors, parameters, summary, build, dict(gives or {}))
        _TYPES[name, stage] = kind
        return build

    return register


def steps() -> tuple[StepType, ...]:
    """Return all steps, by stage in the order of the method, then by name."""
    _load()
    return tuple(sorted(_TYPES.values(), key=lambda kind: (STAGES.index(kind.stage), kind.name)))


def find(name: str, stage: Stage | None = None) -> StepType | None:
    """Return the step of this name, that of the stage if several have it; None for no step."""
    found = {kind.stage: kind for kind in steps() if kind.name == name}
    return found.get(stage) if stage in found else next(iter(found.values()), None)


def resembling(name: str, stage: Stage) -> str:
    """Return the step that was probably meant, of this stage if one is like it; "" when none."""
    known = [kind.name for kind in steps() if kind.stage == stage]
    return closest(name, known) or closest(name, [kind.name for kind in steps()])


def _load() -> None:
    """Import the package whose modules register the built-in steps."""
    importlib.import_module("recipes.steps")
