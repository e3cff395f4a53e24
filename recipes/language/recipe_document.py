"""Parse and check a recipe document; all of its problems are reported at once."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from pydantic import Field, JsonValue, ValidationError, field_validator

from wil_campaign.foundation.files.documents import (
    BadInput,
    Data,
    Document,
    KeyFaultError,
    LaterType,
    Part,
    Path,
    Problem,
    check_document,
    closest_word,
)
from wil_campaign.hooks import recipe_steps
from wil_campaign.installed_plugins import absent_additions
from wil_campaign.recipes.model.recipe import (
    Combination,
    MixingBudget,
    Recipe,
    RecipeSensor,
    StepUse,
)
from wil_campaign.recipes.model.registry import (
    STAGES,
    Stage,
    StepParameters,
    StepType,
    find_step,
    registered_steps,
    resembling_step,
)
from wil_campaign.recipes.operations.step_parameters import IMAGE_SENSORS
from wil_campaign.recipes.working import SIDES, Side
from wil_campaign.vehicles.readings.kinds import sensor_name_type

MAX_SKEW_MS = 100.0
"""Default limit of the skew, so that an overlay is never held for ever."""


SensorType = Annotated[str, LaterType(sensor_name_type)]


class SensorPart(Part):
    """A sensor in a recipe file: the type and rate of its mixed readings.

    real_type, twin_type: the type that a source delivers, if a transform converts it into `type`.
    type: of the mixed readings. rate_hz: the highest rate; by default that of the sources.
    """

    type: SensorType
    rate_hz: Annotated[float, Field(gt=0, le=100_000)] | None = None
    real_type: SensorType | None = None
    twin_type: SensorType | None = None


class CombinePart(Part):
    """A combination in a recipe file; its steps are validated one by one.

    sensor: which of `sensors` is mixed. publish: the vehicles whose autonomy receives the mixture.
    max_skew_ms: the longest time between the two exposures. max_latency_ms: the longest time from
    exposure to delivery. min_rate_hz: the least rate of mixtures. max_registration_error_px: the
    largest distance of virtual objects from their place. publish_raw: whether the autonomy also
    receives the inputs. shows: the objects that mixtures have to show.
    """

    sensor: str
    transform: list[JsonValue] = Field(default_factory=list)
    filter: list[JsonValue] = Field(default_factory=list)
    merge: JsonValue
    publish: Annotated[list[Side], Field(min_length=1)] = Field(default_factory=lambda: [*SIDES])
    max_skew_ms: Annotated[float, Field(gt=0, le=10_000)] = MAX_SKEW_MS
    max_latency_ms: Annotated[float, Field(gt=0, le=10_000)] | None = None
    min_rate_hz: Annotated[float, Field(gt=0, le=100_000)] | None = None
    max_registration_error_px: Annotated[float, Field(gt=0, le=10_000)] | None = None
    publish_raw: bool = False
    shows: Annotated[list[str], Field(min_length=1)] | None = None

    @field_validator("merge")
    @classmethod
    def _some_step(cls, merge: JsonValue) -> JsonValue:
        if merge is None:
            raise ValueError("needs a step, like overlay")
        return merge

    @field_validator("publish")
    @classmethod
    def _once_each(cls, publish: list[Side]) -> list[Side]:
        """Refuse a recipe's combination that names a side twice in `publish`."""
        if len(set(publish)) != len(publish):
            raise ValueError("names a side twice")
        return publish


class RecipePart(Part):
    """A recipe file. twins: names of the twins; only one is supported.

    schema: the kind and version of the file. description: for people. sensors: the mixed sensors,
    by name. combine: how each sensor's readings of real and twin are mixed.
    """

    schema_: Literal["wil/recipe/1"] = Field(alias="schema")
    description: str = ""
    twins: Annotated[list[str], Field(min_length=1)] = Field(default_factory=lambda: ["twin"])
    sensors: Annotated[dict[str, SensorPart], Field(min_length=1)]
    combine: Annotated[list[CombinePart], Field(min_length=1)]

    @field_validator("twins")
    @classmethod
    def _one_twin(cls, twins: list[str]) -> list[str]:
        if len(twins) > 1:
            raise KeyFaultError(
                1, "several twins are not supported yet: a pair is one real vehicle and one twin"
            )
        if twins[0] != "twin":
            raise KeyFaultError(0, "the twin must be named 'twin'", "twin")
        return twins


def load_recipe(document: Document, *, loads_code: bool = True) -> Recipe:
    """Return the recipe in a document. Raises BadInput with every problem.

    loads_code: whether the user's own steps are loaded to check them; False: no user code is run.
    """
    reader = _Reader(document, loads_code=loads_code)
    parsed = [reader.steps_of(index) for index in range(reader.combination_count())]
    try:
        part = check_document(document, RecipePart)
    except BadInput as error:
        raise BadInput(_in_order([*error.problems, *reader.problems])) from None
    sensors = tuple(
        RecipeSensor(name, sensor.type, sensor.rate_hz, sensor.real_type, sensor.twin_type)
        for name, sensor in part.sensors.items()
    )
    _check_sensors(reader, part, sensors, parsed)
    _check_receivers(reader, part)
    if reader.problems:
        raise BadInput(_in_order(reader.problems))
    return Recipe(
        part.description,
        sensors,
        tuple(
            _combination(combine, ("combine", index), sensors, found)
            for index, (combine, found) in enumerate(zip(part.combine, parsed, strict=True))
        ),
        document,
    )


def _combination(
    part: CombinePart, path: Path, sensors: tuple[RecipeSensor, ...], found: list[StepUse]
) -> Combination:
    return Combination(
        sensor=next(sensor for sensor in sensors if sensor.name == part.sensor),
        steps=tuple(step for step in found if step.kind.stage != "merge"),
        merge=next(step for step in found if step.kind.stage == "merge"),
        publish=tuple(part.publish),
        budget=MixingBudget(
            max_skew_s=part.max_skew_ms / 1000.0,
            max_latency_s=None if part.max_latency_ms is None else part.max_latency_ms / 1000.0,
            min_rate_hz=part.min_rate_hz,
            max_registration_error_px=part.max_registration_error_px,
        ),
        publish_raw=part.publish_raw,
        shows=None if part.shows is None else tuple(part.shows),
        path=path,
    )


def _in_order(problems: list[Problem]) -> list[Problem]:
    return sorted(problems, key=lambda problem: (problem.line, problem.column))


def _check_sensors(
    reader: "_Reader",
    part: RecipePart,
    sensors: tuple[RecipeSensor, ...],
    parsed: list[list[StepUse]],
) -> None:
    """Note undeclared sensors of a recipe document, and steps that cannot handle their types."""
    known = {sensor.name: sensor for sensor in sensors}
    for index, (combine, found) in enumerate(zip(part.combine, parsed, strict=True)):
        sensor = known.get(combine.sensor)
        if sensor is None:
            message = f"no sensor '{combine.sensor}' is declared under 'sensors'"
            reader.note(("combine", index, "sensor"), message, closest_word(combine.sensor, known))
        else:
            _check_kinds(reader, sensor, found)
        if (
            combine.max_registration_error_px is not None
            and sensor
            and sensor.kind not in IMAGE_SENSORS
        ):
            message = (
                f"max_registration_error_px does not apply to a {sensor.kind}, which has no pixels"
            )
            reader.note(("combine", index, "max_registration_error_px"), message, key=True)


def _check_kinds(reader: "_Reader", sensor: RecipeSensor, found: list[StepUse]) -> None:
    """Follow each side's sensor type through the recipe's steps; refuse a step that cannot."""
    kinds: dict[Side, str] = {side: sensor.kind_of(side) for side in SIDES}
    for step in found:
        if step.kind.stage == "merge":
            _check_merged(reader, sensor, kinds, step)
        sides: tuple[Side, ...] = step.parameters.sides()
        if not sides:
            sides = ("twin",) if step.kind.stage != "merge" else SIDES
        for kind in dict.fromkeys(kinds[side] for side in sides):
            refusal = _refusal(step, kind)
            if refusal:
                reader.note(step.path, refusal, key=True)
                return
        like = step.parameters.like()
        if like is not None and kinds[like] not in step.kind.sensors:
            message = (
                f"step '{step.kind.name}' is to be like {like}, which is a {kinds[like]} there"
            )
            reader.note(step.path, f"{message}, not {' or '.join(step.kind.sensors)}", key=True)
            return
        for side in sides:
            kinds[side] = step.kind.gives.get(kinds[side], kinds[side])


def _refusal(step: StepUse, kind: str) -> str:
    """Return why a recipe's step does not work on a sensor type; "" when it does."""
    if kind not in step.kind.sensors:
        works = " and ".join(step.kind.sensors)
        return f"step '{step.kind.name}' works on {works}, not on {kind}"
    return step.parameters.refuses(kind)


def _check_merged(
    reader: "_Reader", sensor: RecipeSensor, kinds: dict[Side, str], merge: StepUse
) -> None:
    """Note a side of a recipe's combination that reaches the merge as another sensor type."""
    for side in SIDES:
        if kinds[side] != sensor.kind:
            message = (
                f"{sensor.name} is a {sensor.kind}, but {side} reaches its merge as {kinds[side]};"
                " add a transform that converts one into the other"
            )
            reader.note(merge.path, message, key=True)
            kinds[side] = sensor.kind


def _check_receivers(reader: "_Reader", part: RecipePart) -> None:
    """Refuse two mixtures of one sensor for one vehicle in a recipe document."""
    first: dict[tuple[str, Side], int] = {}
    for index, combine in enumerate(part.combine):
        for side in combine.publish:
            earlier = first.setdefault((combine.sensor, side), index)
            if earlier != index:
                message = (
                    f"'{side}' already receives {combine.sensor} from combination {earlier + 1}"
                )
                reader.note(("combine", index, "publish"), message)


@dataclass(slots=True)
class _Reader:
    """Reads the steps of a recipe document; problems are collected."""

    document: Document
    problems: list[Problem] = field(default_factory=list)
    loads_code: bool = True

    def note(self, path: Path, message: str, suggestion: str = "", *, key: bool = False) -> None:
        self.problems.append(self.document.problem(path, message, suggestion, key=key))

    def combination_count(self) -> int:
        combinations = self.document.get(("combine",))
        return len(combinations) if isinstance(combinations, list) else 0

    def steps_of(self, index: int) -> list[StepUse]:
        """Return the steps of a combination in the recipe document, in order of application."""
        found: list[StepUse] = []
        for stage in STAGES:
            at: Path = ("combine", index, stage)
            given = self.document.get(at)
            if stage == "merge":
                found += self._step(at, given, stage) if given is not None else []
            elif isinstance(given, list):
                for place, one in enumerate(given):
                    found += self._step((*at, place), one, stage)
        self._refuse_second_register(found)
        self._refuse_late_timing(found)
        return found

    def _refuse_late_timing(self, found: list[StepUse]) -> None:
        changed: dict[Side, str] = {}
        for step in found:
            if step.kind.name == "register" or step.kind.stage == "merge":
                continue
            for side in step.parameters.sides():
                if not step.parameters.timed:
                    changed.setdefault(side, step.kind.name)
                elif side in changed:
                    message = (
                        f"'{step.kind.name}' selects among the received readings: "
                        f"it must come before '{changed[side]}'"
                    )
                    self.note(step.path, message, key=True)
                    break

    def _refuse_second_register(self, found: list[StepUse]) -> None:
        """Refuse a second `register` step of a recipe's side."""
        for second in [step for step in found if step.kind.name == "register"][1:]:
            self.note(second.path, "a second 'register'; a combination has one", key=True)

    def _step(self, at: Path, given: Data, stage: Stage) -> list[StepUse]:
        """Return the steps at a path of the recipe document; none when something is wrong."""
        if isinstance(given, str):
            kind = self._kind(at, given, stage)
            return self._bare(at, kind) if kind is not None else []
        if isinstance(given, dict) and "use" in given:
            own = find_step("use", stage)
            return self._step_with_parameters(own, at, shorthand=False) if own is not None else []
        if not isinstance(given, dict) or len(given) != 1:
            example = next(kind.name for kind in registered_steps() if kind.stage == stage)
            self.note(at, f"a step is a name, or one mapping {{{example}: parameters}}")
            return []
        ((name, value),) = given.items()
        kind = self._kind((*at, name), name, stage)
        if kind is None:
            return []
        return self._step_with_parameters(kind, (*at, name), shorthand=not isinstance(value, dict))

    def _step_with_parameters(self, kind: StepType, at: Path, *, shorthand: bool) -> list[StepUse]:
        """Return the recipe's step with the parameters at a path; none when they are wrong."""
        try:
            parameters = check_document(self.document, kind.parameters, at)
        except BadInput as error:
            self.problems += error.problems
            return []
        step = StepUse(kind, parameters, at, shorthand)
        is_checked = self.loads_code or not parameters.reference()
        for fault in parameters.faults(self.document.path.parent) if is_checked else ():
            self.note(step.place_of(fault.path), fault.message, fault.suggestion)
        return [step]

    def _bare(self, at: Path, kind: StepType) -> list[StepUse]:
        """Return a recipe's step that is named without parameters; none when it needs some."""
        try:
            parameters: StepParameters = kind.parameters()
        except ValidationError:
            known = ", ".join(kind.parameters.model_fields)
            self.note(at, f"step '{kind.name}' needs parameters ({known})")
            return []
        return [StepUse(kind, parameters, at)]

    def _kind(self, at: Path, name: str, stage: Stage) -> StepType | None:
        """Return the step type of a name in the recipe document; an unknown name is noted."""
        kind = find_step(name, stage)
        if kind is None and (why := absent_additions(recipe_steps).get(name)):
            self.note(at, why, key=True)
            return None
        if kind is None:
            meant = resembling_step(name, stage)
            known = ", ".join(step.name for step in registered_steps() if step.stage == stage)
            hint = "" if meant else f" (known for {stage}: {known})"
            self.note(at, f"unknown step '{name}'{hint}", meant, key=True)
            return None
        if kind.stage != stage:
            self.note(at, f"step '{name}' belongs under '{kind.stage}', not '{stage}'", key=True)
            return None
        return kind
