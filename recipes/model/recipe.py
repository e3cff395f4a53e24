"""A checked recipe: its sensors, combinations, steps and budgets."""

from dataclasses import dataclass

from wil_campaign.foundation.files.documents import Document, Path, Problem, closest_word
from wil_campaign.recipes.model.registry import StepParameters, StepType
from wil_campaign.recipes.working import Side
from wil_campaign.vehicles.readings.kinds import traits_named


@dataclass(frozen=True, slots=True)
class StepUse:
    """A step of a recipe with its parameters. path: of these in the document."""

    kind: StepType
    parameters: StepParameters
    path: Path
    shorthand: bool = False

    def place_of(self, inner: Path) -> Path:
        """Return the path in the recipe document of a parameter of this step."""
        return (*self.path, *(inner[1:] if self.shorthand else inner))

    @property
    def label(self) -> str:
        """Return the recipe step's name in messages."""
        return self.parameters.label() or self.kind.name


@dataclass(frozen=True, slots=True)
class RecipeSensor:
    """A sensor that a recipe declares.

    kind: type of the mixed readings. rate_hz: of these; None: the real's. real_kind, twin_kind:
    type that the two sources deliver, which transforms convert into `kind`; None: the same.
    """

    name: str
    kind: str
    rate_hz: float | None
    real_kind: str | None = None
    twin_kind: str | None = None

    def kind_of(self, side: Side) -> str:
        """Return the sensor type that a side's source delivers to the recipe."""
        return (self.real_kind if side == "real" else self.twin_kind) or self.kind


@dataclass(frozen=True, slots=True)
class MixingBudget:
    """A recipe's mixing budget for a sensor: beyond it a run is INVALID; None: no limit.

    max_skew_s: between the two exposures. max_latency_s: from the older exposure to delivery.
    min_rate_hz: of the mixed readings. max_registration_error_px: of the overlay.
    """

    max_skew_s: float
    max_latency_s: float | None = None
    min_rate_hz: float | None = None
    max_registration_error_px: float | None = None


@dataclass(frozen=True, slots=True)
class Combination:
    """A recipe's combination: how one sensor's readings are mixed, and for which vehicles.

    steps: transforms and filters in their order. budget: an overlay beyond its skew or latency is
    not drawn. publish_raw: whether S and Sv are published as well as Sm. shows: the virtual objects
    that the mixture has to show; None: all that it can. path: in the document.
    """

    sensor: RecipeSensor
    steps: tuple[StepUse, ...]
    merge: StepUse
    publish: tuple[Side, ...]
    budget: MixingBudget
    publish_raw: bool = False
    shows: tuple[str, ...] | None = None
    path: Path = ()

    @property
    def max_skew_s(self) -> float:
        """Return the largest skew of exposures that the recipe's combination allows."""
        return self.budget.max_skew_s

    def isolated(self) -> set[str]:
        """Return the objects that `isolate_objects` keeps by name; empty without that step."""
        return {
            name
            for step in self.steps
            if step.kind.name == "isolate_objects"
            for _, name in step.parameters.objects()
        }

    def tolerated(self, side: Side) -> frozenset[str]:
        """Return the reading faults that the recipe's steps correct, or that are no faults.

        The twin's may be empty where its world need not have an object within range.
        """
        of_side = (step.parameters for step in self.steps if side in step.parameters.sides())
        may_be_empty = side == "twin" and traits_named(self.sensor.kind_of(side)).may_be_empty
        start = frozenset({"empty"} if may_be_empty else ())
        return start.union(*(parameters.tolerates for parameters in of_side))


@dataclass(frozen=True, slots=True)
class Recipe:
    """A recipe file's combinations."""

    description: str
    sensors: tuple[RecipeSensor, ...]
    combinations: tuple[Combination, ...]
    document: Document

    def sensors_for(self, vehicle: Side) -> frozenset[str]:
        """Return the names of the sensors of which a vehicle gets mixtures."""
        return frozenset(one.sensor.name for one in self.combinations if vehicle in one.publish)

    def references(self) -> tuple[str, ...]:
        """Return the user's code that the steps run, each once: file.py:name, or a network."""
        used = (
            step.parameters.reference()
            for combination in self.combinations
            for step in (*combination.steps, combination.merge)
        )
        return tuple(dict.fromkeys(reference for reference in used if reference))

    def objects(self) -> tuple[tuple[Path, str], ...]:
        """Return the world objects that the recipe names, each with its path in the document."""
        named = tuple(
            (step.place_of(path), name)
            for combination in self.combinations
            for step in (*combination.steps, combination.merge)
            for path, name in step.parameters.objects()
        )
        shown = tuple(
            ((*combination.path, "shows", index), name)
            for combination in self.combinations
            for index, name in enumerate(combination.shows or ())
        )
        return named + shown

    def unknown_objects(self, known: frozenset[str]) -> tuple[Problem, ...]:
        """Return a problem for each object that the recipe names and the world lacks."""
        return tuple(
            self.document.problem(
                path, f"no object '{name}' in the world", closest_word(name, known)
            )
            for path, name in self.objects()
            if name not in known
        )
