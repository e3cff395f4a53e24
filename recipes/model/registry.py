"""The registry of the steps that a recipe can name: the core's, and those of plugins.

A step is a function that builds an operator from its parameters; the first line of its docstring
is its summary in the listing.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path as FilePath
from typing import Any, ClassVar, Literal, TypeVar

from pydantic import model_validator

from wil_campaign.foundation.files.documents import Part, Path, closest_word
from wil_campaign.hooks import recipe_steps
from wil_campaign.installed_plugins import loaded_additions, require_derived
from wil_campaign.recipes.working import Built, Need, Side
from wil_campaign.vehicles.readings import sensor_names
from wil_campaign.vehicles.readings.kinds import traits_named
from wil_campaign.vehicles.readings.traits import ReadingTraits

Stage = Literal["transform", "filter", "merge"]
OWN_STEP = "use"
"""Name of the step that calls the user's code, in every stage."""
EVERY_SENSOR: tuple[str, ...] = ()
"""The types of a step that works on all of them, those of plugins included."""
_OURS = "wil_campaign."
STAGES: tuple[Stage, ...] = ("transform", "filter", "merge")


@dataclass(frozen=True, slots=True)
class ParameterFault:
    """A fault of a registered step's parameter that depends on other files."""

    path: Path
    message: str
    suggestion: str = ""


class StepParameters(Part):
    """The base of the parameters that a registered step takes; unknown keys are refused.

    shorthand: the parameter that is set by a value that is no mapping: `resize: real`. needs: what
    the step needs of a side's readings in addition to their values. tolerates: faults of a reading
    (vehicles/readings/checks) that the step corrects. timed: whether the step selects among a
    side's readings by time; it then has to come before all others of that side. reshapes: whether
    the step may change the size of an image, or the beams of a scan.
    """

    shorthand: ClassVar[str] = ""
    needs: ClassVar[frozenset[Need]] = frozenset()
    tolerates: ClassVar[frozenset[str]] = frozenset()
    timed: ClassVar[bool] = False
    reshapes: ClassVar[bool] = False

    @model_validator(mode="before")
    @classmethod
    def _expand(cls, given: object) -> object:
        """Accept a bare value for the step's main parameter (`shorthand`)."""
        if cls.shorthand and given is not None and not isinstance(given, dict):
            return {cls.shorthand: given}
        return given

    def sides(self) -> tuple[Side, ...]:
        """Return the sides that the registered step works on; a merge works on none alone."""
        return ()

    def needed(self) -> frozenset[Need]:
        """Return what readings must carry for the step as configured: depth, object ids."""
        return self.needs

    def label(self) -> str:
        """Return the step's name in messages; "" for its registered name."""
        return ""

    def refuses(self, kind: str) -> str:
        """Return why the step as configured cannot handle a sensor type; "" if it can."""
        del kind
        return ""

    def faults(self, folder: FilePath) -> tuple[ParameterFault, ...]:
        """Return the faults of files named in a step's parameters, relative to a folder."""
        del folder
        return ()

    def reference(self) -> str:
        """Return the user's code that the step runs: file.py:name, or a network; "" for none."""
        return ""

    def objects(self) -> tuple[tuple[Path, str], ...]:
        """Return the world objects named in a step's parameters, each with its path."""
        return ()

    def like(self) -> Side | None:
        """Return the side whose reading gives the step a size, beams or colours; None for none."""
        return None

    def covers_with(self) -> Side | None:
        """Return the side that hides all of the other in a merge, where nothing filters it."""
        return None


class SidedParameters(StepParameters):
    """Parameters of a transform or filter step. on: the side it works on, usually the twin."""

    on: Literal["real", "twin", "both"] = "twin"

    def sides(self) -> tuple[Side, ...]:
        """Return the sides (`on`) that the transform or filter step works on."""
        return ("real", "twin") if self.on == "both" else (self.on,)


@dataclass(frozen=True, slots=True)
class StepContext:
    """The context in which a registered step is built when a recipe is compiled.

    object_ids: ids of the twin's world. folder: to which files in the recipe are relative. side:
    the one that an operator is built for; None for a merge.
    """

    object_ids: Mapping[str, int] = field(default_factory=dict)
    folder: FilePath = FilePath()
    side: Side | None = None


@dataclass(frozen=True, slots=True)
class StepType:
    """A registered step: its name, stage, parameters and builder.

    only: the types that it works on, none for all; or whether it works on readings with some
    traits. gives: the type into which it converts one of these, where that is a different one.
    summary: one sentence.
    """

    name: str
    stage: Stage
    only: tuple[str, ...] | Callable[[ReadingTraits], bool]
    parameters: type[StepParameters]
    summary: str
    build: Callable[[Any, StepContext], Built]
    gives: Mapping[str, str] = field(default_factory=dict)

    @property
    def sensors(self) -> tuple[str, ...]:
        """Return the types of sensors that the step works on."""
        if not callable(self.only):
            return self.only or sensor_names()
        return tuple(name for name in sensor_names() if self.only(traits_named(name)))

    @property
    def is_of_others(self) -> bool:
        """Return whether the step's code is none of this program: of a user, or of their plugin."""
        return self.name == OWN_STEP or not self.build.__module__.startswith(_OURS)


P = TypeVar("P", bound=StepParameters)
B = TypeVar("B", bound=Built)


def step(
    name: str,
    *,
    stage: Stage,
    sensors: tuple[str, ...] | Callable[[ReadingTraits], bool],
    parameters: type[P],
    gives: Mapping[str, str] | None = None,
) -> Callable[[Callable[[P, StepContext], B]], StepType]:
    """Return a decorator that makes a function the step of this name (`StepType`).

    The function gets the step's parameters and a `StepContext`, once for each recipe, and returns
    what is called with each reading: of a transform and a filter a function of this side's and the
    other's `Masked` (or None), which returns a `Masked` or a reading; of a merge one of a mapping
    of both sides. sensors: the types that it works on; () for all. parameters: derived from
    `SidedParameters`, of a merge from `StepParameters`. Raises TypeError, ValueError.
    """
    if stage not in STAGES:
        raise ValueError(f"step {name!r}: stage is {stage!r}, not one of {', '.join(STAGES)}")
    if isinstance(sensors, str):
        raise TypeError(f"step {name!r}: sensors is {sensors!r}, not ({sensors!r},)")
    require_derived(parameters, StepParameters, f"step {name!r}")

    def make(build: Callable[[P, StepContext], B]) -> StepType:
        summary = (build.__doc__ or "").partition("\n")[0].strip()
        return StepType(name, stage, sensors, parameters, summary, build, dict(gives or {}))

    return make


@cache
def registered_steps() -> tuple[StepType, ...]:
    """Return all steps, by stage in the order of the method, then by name.

    Raises BadInput for a plugin that cannot be used.
    """
    found: list[StepType] = []
    for kinds in loaded_additions(recipe_steps, "step").values():
        found += kinds if isinstance(kinds, tuple) else (kinds,)
    return tuple(sorted(found, key=lambda kind: (STAGES.index(kind.stage), kind.name)))


def find_step(name: str, stage: Stage | None = None) -> StepType | None:
    """Return the registered step of a name, of that stage if several have it; None for no step."""
    found = {kind.stage: kind for kind in registered_steps() if kind.name == name}
    return found.get(stage) if stage in found else next(iter(found.values()), None)


def resembling_step(name: str, stage: Stage) -> str:
    """Return the registered step that a misspelt name probably means, of this stage first."""
    known = [kind.name for kind in registered_steps() if kind.stage == stage]
    return closest_word(name, known) or closest_word(
        name, [kind.name for kind in registered_steps()]
    )
