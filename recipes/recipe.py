"""A recipe as the code uses it: checked, frozen."""

from dataclasses import dataclass

from recipes.registry import StepParameters, StepType
from recipes.working import Side
from worlds.documents import Document, Path, Problem, closest


@dataclass(frozen=True, slots=True)
class Step:
    """A step of a recipe. path: where it stands in the document, down to its parameters."""

    kind: StepType
    parameters: StepParameters
    path: Path
    shorthand: bool = False

    def place_of(self, inner: Path) -> Path:
        """Return the path in the document of a parameter of this step."""
        return (*self.path, *(inner[1:] if self.shorthand else inner))


@dataclass(frozen=True, slots=True)
class Sensor:
    """A sensor that the recipe declares. rate_hz: of the mixed readings; None: the real's."""

    name: str
    kind: str
    rate_hz: float | None


@dataclass(frozen=True, slots=True)
class Combination:
    """How one sensor's readings are mixed, and for whom.

    steps: transforms and filters in their order. max_skew_s: an overlay whose exposure differs by
    more is not drawn.
    """

    sensor: Sensor
    steps: tuple[Step, ...]
    merge: Step
    publish: tuple[Side, ...]
    max_skew_s: float


@dataclass(frozen=True, slots=True)
class Recipe:
    """All combinations of a recipe file."""

    description: str
    sensors: tuple[Sensor, ...]
    combinations: tuple[Combination, ...]
    document: Document

    def objects(self) -> tuple[tuple[Path, str], ...]:
        """Return the objects that the recipe names, each with its path in the document."""
        return tuple(
            (step.place_of(path), name)
            for combination in self.combinations
            for step in combination.steps
            for path, name in step.parameters.objects()
        )

    def unknown_objects(self, known: frozenset[str]) -> tuple[Problem, ...]:
        """Return a problem for each object named that the world does not know."""
        return tuple(
            self.document.problem(path, f"no object '{name}' in the world", closest(name, known))
            for path, name in self.objects()
            if name not in known
        )
