"""The oracle interface, and what an oracle says of itself to be found and shown.

Oracles are pure and online: samples in the order of their times in, flags out, and at the end one
result. They read no clock, so that judging a recording gives the results of judging the flight.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, get_args

from wil_campaign.foundation.files.documents import Data
from wil_campaign.installed_plugins import plugin_of_module, require_derived, whose_fault_text
from wil_campaign.safety.model.oracle_results import Flag, Limit, OracleResult
from wil_campaign.safety.model.samples import (
    FenceSample,
    LinkSample,
    PoseSample,
    ReferenceSample,
    StageSample,
    StateSample,
)
from wil_campaign.safety.oracles.oracle_context import (
    GateOpening,
    ObjectSeparation,
    OracleContext,
    RunMode,
    WorldProbe,
)
from wil_campaign.safety.oracles.oracle_terms import (
    FLIGHT,
    OracleParameters,
    OracleTerms,
    StageTracker,
    StageWindow,
    Windowed,
)
from wil_campaign.vehicles.driver.vehicle_state import ReportName

__all__ = [
    "NO_FLAGS",
    "Flags",
    "GateOpening",
    "MotionName",
    "ObjectSeparation",
    "Oracle",
    "OracleContext",
    "OracleError",
    "OracleParameters",
    "OracleSpec",
    "OracleTerms",
    "RunMode",
    "StageTracker",
    "StageWindow",
    "Windowed",
    "WorldProbe",
    "oracle",
]

MotionName = Literal["velocity", "attitude"]
Flags = tuple[Flag, ...]
NO_FLAGS: Flags = ()


class OracleError(Exception):
    """An oracle cannot be built for this run; the message names it and the reason.

    key: the parameter at fault; empty for none. offset: where in the text of that parameter.
    suggestion: what was probably meant.
    """

    def __init__(
        self, message: str, *, key: str = "", offset: int | None = None, suggestion: str = ""
    ) -> None:
        super().__init__(message)
        self.key = key
        self.offset = offset
        self.suggestion = suggestion


class Oracle(ABC):
    """The base of oracles, each of one vehicle (`watches`: the vehicles whose samples it gets).

    reports: the reports of a vehicle that it needs: without them it cannot judge. motion: what it
    needs of a pose besides the position. is_certain: a FAIL of its result so far is one whatever
    follows; of other oracles only one with a decisive flag is, else it means "not yet".
    """

    reports: frozenset[ReportName] = frozenset()
    motion: frozenset[MotionName] = frozenset()
    is_certain: ClassVar[bool] = False

    def __init__(self, terms: OracleTerms) -> None:
        self.terms = terms
        self.name = terms.name
        self.vehicle = terms.vehicle
        self.required = terms.required
        self.stages = StageTracker(terms.window)

    @property
    def watches(self) -> tuple[str, ...]:
        """Return the vehicles whose samples the oracle takes."""
        return (self.vehicle,)

    def on_pose(self, sample: PoseSample) -> Flags:
        """Give the oracle a pose."""
        del sample
        return NO_FLAGS

    def on_state(self, sample: StateSample) -> Flags:
        """Give the oracle a vehicle's state."""
        del sample
        return NO_FLAGS

    def on_reference(self, sample: ReferenceSample) -> Flags:
        """Give the oracle a pose by another source than the judged one, as the estimate."""
        del sample
        return NO_FLAGS

    def on_received(self, sample: LinkSample) -> Flags:
        """Tell the oracle that a vehicle's link delivered something."""
        del sample
        return NO_FLAGS

    def on_stage(self, sample: StageSample) -> Flags:
        """Tell the oracle that the run reached a stage."""
        self.stages.reach(sample)
        return NO_FLAGS

    def on_fence(self, sample: FenceSample) -> Flags:
        """Tell the oracle that a vehicle's fence changed."""
        del sample
        return NO_FLAGS

    def on_tick(self, t_s: float) -> Flags:
        """Tell the oracle that time has passed, for oracles that judge silence."""
        del t_s
        return NO_FLAGS

    @abstractmethod
    def result(self, t_s: float) -> OracleResult:
        """Return the oracle's result as of run time `t_s`."""

    def so_far(self, t_s: float) -> OracleResult:
        """Return the result so far for displays, which ask up to twenty times a second in flight.

        An oracle overrides it where its result takes longer the longer the run is.
        """
        return self.result(t_s)

    @property
    def worst_text(self) -> str:
        """Return the worst value for the reason of a FAIL; "" where its flag says it already."""
        return ""

    def flag(self, t_s: float, text: str, *, decisive: bool = True) -> Flags:
        """Return a flag of this oracle."""
        return (Flag(t_s, self.name, self.vehicle, text, decisive),)

    def verdict(
        self,
        *,
        passed: bool,
        actual: float | None = None,
        limit: Limit = None,
        unit: str = "",
        margin: float | None = None,
        at_s: float | None = None,
        detail: str = "",
    ) -> OracleResult:
        """Return this oracle's result; INVALID if one of its numbers is not finite."""
        numbers = [x for x in (actual, margin, at_s) if x is not None]
        if not all(map(math.isfinite, numbers)):
            given = f"value {actual}, margin {margin}"
            return self.invalid(f"it got a value that is not finite ({given})")
        return OracleResult(
            name=self.name,
            vehicle=self.vehicle,
            required=self.required,
            verdict="PASS" if passed else "FAIL",
            actual=actual,
            limit=limit,
            unit=unit,
            margin=margin,
            at_s=at_s,
            detail=detail,
        )

    def invalid(self, detail: str, *, at_s: float | None = None) -> OracleResult:
        """Return the result INVALID. detail: which signal is missing, and when."""
        return replace(self.verdict(passed=False, at_s=at_s, detail=detail), verdict="INVALID")


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalLimit:
    """A limit on one signal that an oracle holds, as reports draw it.

    signal: its name. from_s, until_s: when it holds, from the opening of the oracle's window on;
    None: to its end. in_the_air: it does not hold while the vehicle takes off or lands. text: the
    condition, with which the detail of a failure begins.
    """

    signal: str
    value: float
    is_upper: bool
    from_s: float = 0.0
    until_s: float | None = None
    in_the_air: bool = False
    text: str = ""


@dataclass(frozen=True, slots=True)
class OwnKey:
    """A parameter by which an oracle of the user's own name says its kind, in place of `use`.

    noun: what its value is ("a formula"). summary: what JSON Schemas say of it.
    """

    key: str
    noun: str
    summary: str


Objects = Callable[[Any, Collection[str]], Iterable[str]]
Limits = Callable[[Mapping[str, Data]], Iterable[SignalLimit]]


def _no_limits(_: Mapping[str, Data]) -> tuple[SignalLimit, ...]:
    return ()


Factory = Callable[[OracleTerms, Any, OracleContext], Oracle]
"""Builds an oracle from its terms, its parameters, and the context."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OracleSpec:
    """A registered kind of oracle that campaigns may name.

    pair_only: it compares two vehicles and is left out where only one flies; a function of the
    parameters if these decide. at_the_end: whether it fails is known at the end only. window,
    fail_fast: the defaults where the campaign gives none. own_key: of its parameters. objects: of
    the parameters and of the names of the world's objects: the objects that it names. limits: of
    the parameters as a file has them, unchecked: the limits that it holds. without_world: of the
    parameters: names of objects that the world would need, to check it without one; None where it
    cannot be checked then. signals: by name the unit and the meaning of what it may name.
    """

    name: str
    summary: str
    parameters: type[OracleParameters]
    factory: Factory
    pair_only: bool | Callable[[Any], bool] = False
    at_the_end: bool = False
    window: StageWindow = FLIGHT
    fail_fast: bool = False
    own_key: OwnKey | None = None
    objects: Objects = lambda _, __: ()
    limits: Limits = _no_limits
    without_world: Callable[[Any], tuple[str, ...]] | None = None
    signals: Callable[[], Mapping[str, tuple[str, str]]] = dict

    @property
    def has_limit(self) -> bool:
        """Return whether it has a limit that a file may set: a number, a formula, a fence."""
        own = set(self.parameters.model_fields) - set(Windowed.model_fields)
        numbers = (self.parameters.model_fields[name].annotation for name in own)
        is_number = any({int, float} & {one, *get_args(one)} for one in numbers)
        return is_number or self.limits is not _no_limits or self.own_key is not None

    def needs_pair(self, parameters: OracleParameters) -> bool:
        """Return whether the oracle needs two vehicles."""
        return self.pair_only(parameters) if callable(self.pair_only) else self.pair_only

    def build(
        self, name: str, parameters: OracleParameters, context: OracleContext, *, required: bool
    ) -> Oracle:
        """Return the oracle for one vehicle of one run. Raises OracleError."""
        window, fail_fast = self.window, self.fail_fast
        if isinstance(parameters, Windowed):
            try:
                window = parameters.window(self.window)
            except ValueError as error:
                key = "from" if parameters.to is None else "to"
                raise OracleError(f"oracle {name!r}: {error}", key=key) from error
            if parameters.fail_fast and self.at_the_end:
                message = f"oracle {name!r}: its result is only known at the end of its window"
                raise OracleError(message, key="fail_fast")
            fail_fast = self.fail_fast if parameters.fail_fast is None else parameters.fail_fast
        terms = OracleTerms(
            name=name,
            vehicle=context.vehicle,
            required=required,
            window=window,
            fail_fast=fail_fast and required,
        )
        try:
            return _checked(self.factory(terms, parameters, context))
        except Exception as error:
            if not isinstance(error, OracleError):
                module = self.factory.__module__
                whose = whose_fault_text(plugin_of_module(module))
                error.add_note(f"(oracle {name!r}, made by {module}){whose}")
            raise


def _checked(made: Any) -> Oracle:
    if not isinstance(made, Oracle):
        raise TypeError(f"gave {type(made).__name__}, not an Oracle")
    return made


def oracle(
    name: str,
    summary: str,
    parameters: type[OracleParameters],
    *,
    pair_only: bool | Callable[[Any], bool] = False,
    at_the_end: bool = False,
    window: StageWindow = FLIGHT,
    fail_fast: bool = False,
    own_key: OwnKey | None = None,
    objects: Objects = lambda _, __: (),
    limits: Limits = _no_limits,
    without_world: Callable[[Any], tuple[str, ...]] | None = None,
    signals: Callable[[], Mapping[str, tuple[str, str]]] = dict,
) -> Callable[[Factory], OracleSpec]:
    """Return a decorator that makes a factory of oracles a kind of oracle (`OracleSpec`).

    The factory gets the oracle's terms (its name, vehicle and window), the keys of the file, and an
    `OracleContext` of the vehicle and its world; it returns an oracle for that vehicle. parameters:
    those keys, derived from `OracleParameters`, as `Windowed` is. Raises TypeError for others.
    """
    require_derived(parameters, OracleParameters, f"oracle {name!r}")

    def make(factory: Factory) -> OracleSpec:
        return OracleSpec(
            name=name,
            summary=summary,
            parameters=parameters,
            factory=factory,
            pair_only=pair_only,
            at_the_end=at_the_end,
            window=window,
            fail_fast=fail_fast,
            own_key=own_key,
            objects=objects,
            limits=limits,
            without_world=without_world,
            signals=signals,
        )

    return make
