"""The oracle interface and the registry.

Oracles are pure and online: samples in the order of their times in, flags out, and at the end one
result. They read no clock, so that judging a recording gives the results of judging the flight.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

from safety.model.oracle_results import Flag, Limit, OracleResult
from safety.model.samples import FenceSample, LinkSample, PoseSample, StageSample, StateSample
from safety.oracles.oracle_context import Gate, OracleContext, Probe, RunMode, Separation
from safety.oracles.oracle_terms import FLIGHT, Parameters, Stages, Terms, Window, Windowed
from vehicles.driver.vehicle_state import ReportName

__all__ = [
    "NO_FLAGS",
    "Flags",
    "Gate",
    "MotionName",
    "Oracle",
    "OracleContext",
    "OracleError",
    "OracleSpec",
    "Parameters",
    "Probe",
    "RunMode",
    "Separation",
    "Stages",
    "Terms",
    "Window",
    "Windowed",
    "oracle",
    "registry",
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
    needs of a pose besides the position. is_costly: computing its result takes longer the longer
    the run is, too long to be done in flight.
    """

    reports: frozenset[ReportName] = frozenset()
    motion: frozenset[MotionName] = frozenset()
    is_costly: ClassVar[bool] = False

    def __init__(self, terms: Terms) -> None:
        self.terms = terms
        self.name = terms.name
        self.vehicle = terms.vehicle
        self.required = terms.required
        self.stages = Stages(terms.window)

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
            bad = f"it got a value that is not finite ({actual})"
            return self.invalid(bad)
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


Factory = Callable[[Terms, Any, OracleContext], Oracle]
"""Builds an oracle from its terms, its parameters, and the context."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OracleSpec:
    """A registered kind of oracle that campaigns may name.

    pair_only: it compares two vehicles and is left out where only one flies; a function of the
    parameters if these decide. at_the_end: whether it fails is known at the end only. window,
    fail_fast: the defaults where the campaign gives none.
    """

    name: str
    summary: str
    parameters: type[Parameters]
    factory: Factory
    pair_only: bool | Callable[[Any], bool] = False
    at_the_end: bool = False
    window: Window = FLIGHT
    fail_fast: bool = False

    def needs_pair(self, parameters: Parameters) -> bool:
        """Return whether the oracle needs two vehicles."""
        return self.pair_only(parameters) if callable(self.pair_only) else self.pair_only

    def build(
        self, name: str, parameters: Parameters, context: OracleContext, *, required: bool
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
        terms = Terms(
            name=name,
            vehicle=context.vehicle,
            required=required,
            window=window,
            fail_fast=fail_fast and required,
        )
        return self.factory(terms, parameters, context)


registry: dict[str, OracleSpec] = {}


def oracle(
    name: str,
    summary: str,
    parameters: type[Parameters],
    *,
    pair_only: bool | Callable[[Any], bool] = False,
    at_the_end: bool = False,
    window: Window = FLIGHT,
    fail_fast: bool = False,
) -> Callable[[Factory], Factory]:
    """Register a factory of oracles under a name. Raises ValueError when the name is taken."""

    def register(factory: Factory) -> Factory:
        if name in registry:
            raise ValueError(f"oracle {name!r} is registered twice")
        registry[name] = OracleSpec(
            name=name,
            summary=summary,
            parameters=parameters,
            factory=factory,
            pair_only=pair_only,
            at_the_end=at_the_end,
            window=window,
            fail_fast=fail_fast,
        )
        return factory

    return register
