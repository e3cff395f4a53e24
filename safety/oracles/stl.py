"""An STL formula over the signals of a run, its robustness as the margin."""

from array import array
from typing import Annotated

import numpy as np
from pydantic import Field

from safety.oracles.base import (
    NO_FLAGS,
    Flags,
    Oracle,
    OracleContext,
    OracleError,
    Terms,
    Windowed,
    oracle,
)
from safety.oracles.stl_signals import TWIN_DISTANCE_NAME, FenceMargin, Signal, Together, signals_of
from safety.oracles.terms import ON_GOAL
from safety.results import OracleResult
from safety.samples import FenceSample, HeardSample, PoseSample, StateSample
from safety.stl.formula import Comparison, Formula, StlError, names_of
from safety.stl.parser import parse_stl
from safety.stl.robustness import (
    Occurrence,
    Robustness,
    StlMonitor,
    Values,
    is_strict,
    limit_side,
    value_of,
)
from safety.stl.units import require_sound, unit_text

_CHECK_EVERY_S = 1.0
"""How often a formula that is to fail fast is looked at: each look costs up to some 20 ms."""


class StlParameters(Windowed):
    """stl: the formula; its times count from the stage that opens the window."""

    stl: Annotated[
        str, Field(description='the formula, such as "always[0,30] (clearance_m >= 0.1)"')
    ]


class Trace:
    """The values of some signals over time: a row whenever one of them is told anew."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self.times_s = array("d")
        self._rows = {name: array("d") for name in names}
        self._latest: dict[str, float] = {}

    @property
    def missing(self) -> tuple[str, ...]:
        """Return the signals that never had a value."""
        return tuple(name for name in self._rows if name not in self._latest)

    def note(self, name: str, value: float | None) -> None:
        """Take a value; it counts from the next row on."""
        if value is not None:
            self._latest[name] = value

    def add_row(self, t_s: float) -> None:
        """Add what is known now, once all of them are; a sample that is late counts as now."""
        if len(self._latest) < len(self._rows):
            return
        if self.times_s and t_s <= self.times_s[-1]:
            for name, row in self._rows.items():
                row[-1] = self._latest[name]
            return
        self.times_s.append(t_s)
        for name, row in self._rows.items():
            row.append(self._latest[name])

    def values(self) -> dict[str, Values]:
        """Return the values of each signal, one per row."""
        return {name: np.array(row) for name, row in self._rows.items()}


class Stl(Oracle):
    """Has a formula hold from the stage that opens its window on.

    actual, limit, unit, at_s: of the comparison that decides. margin: the robustness; 0 of a
    strict comparison fails. The last values before the end of the window last on.
    """

    def __init__(self, terms: Terms, *, text: str, context: OracleContext) -> None:
        super().__init__(terms)
        self._formula, self._signals = _read(terms, text, context, self)
        self._kinds = {name: signal.kind for name, signal in self._signals.items()}
        names = tuple(dict.fromkeys(name.name for name in names_of(self._formula)))
        self._used = {name: self._signals[name] for name in names}
        self._trace = Trace(names)
        self._monitor = StlMonitor(self._formula)
        self._together = Together()
        self._heard_s: float | None = None
        self._look_s = 0.0
        self._flagged = False

    @property
    def watches(self) -> tuple[str, ...]:
        """Return both vehicles where the distance between them is asked for."""
        both = any(signal.of_both for signal in self._used.values())
        return ("real", "twin") if both else (self.vehicle,)

    def on_pose(self, sample: PoseSample) -> Flags:
        """Take a pose of either vehicle; those of its own make a row."""
        together_m = self._together.take(sample)
        if sample.vehicle != self.vehicle:
            return NO_FLAGS
        for name, signal in self._used.items():
            if signal.of_pose is not None:
                self._trace.note(name, signal.of_pose(sample))
            elif signal.of_both:
                self._trace.note(name, together_m)
        self._add_row(sample.t_s)
        return NO_FLAGS

    def on_state(self, sample: StateSample) -> Flags:
        """Take a state: a row as well, so that formulas about it need no pose."""
        if sample.vehicle != self.vehicle:
            return NO_FLAGS
        for name, signal in self._used.items():
            if signal.of_state is not None:
                self._trace.note(name, signal.of_state(sample))
        self._add_row(sample.t_s)
        return NO_FLAGS

    def on_heard(self, sample: HeardSample) -> Flags:
        """Take a sign of life."""
        if sample.vehicle == self.vehicle:
            self._heard_s = sample.t_s
        return NO_FLAGS

    def on_fence(self, sample: FenceSample) -> Flags:
        """Take that the operator gave a vehicle another fence."""
        for signal in self._used.values():
            if sample.vehicle == self.vehicle and isinstance(signal.of_pose, FenceMargin):
                signal.of_pose.fence = sample.fence
        return NO_FLAGS

    def on_tick(self, t_s: float) -> Flags:
        """Look, where it is to fail fast, whether the formula can hold still."""
        due = self.terms.fail_fast and not self._flagged and t_s >= self._look_s
        if not due or not self.stages.open or not self._trace.times_s:
            return NO_FLAGS
        self._look_s = t_s + _CHECK_EVERY_S
        best = self._monitor.at_best(self._times_s(), self._trace.values(), t_s)
        if best >= 0.0:
            return NO_FLAGS
        self._flagged = True
        return self.flag(t_s, f"{self.vehicle}: {self.name} cannot hold any more ({best:.3g})")

    def result(self, t_s: float) -> OracleResult:
        """Return the robustness of what was recorded in the window."""
        if self._trace.missing or not self._trace.times_s:
            missing = ", ".join(self._trace.missing) or "nothing was recorded in its window"
            detail = f"never told: {missing}" if self._trace.missing else missing
            return self.verdict(passed=False, detail=detail)
        values = self._trace.values()
        end_s = self.stages.end_s if self.stages.end_s is not None else t_s
        found = self._monitor.robustness(self._times_s(), values, end_s)
        if found.decided_by is None:
            return self.verdict(passed=found.value >= 0.0, margin=found.value)
        return self._decided(found, *found.decided_by, values)

    def _decided(
        self, found: Robustness, by: Occurrence, index: int, values: dict[str, Values]
    ) -> OracleResult:
        actual: float | None = None
        limit: float | None = None
        unit = ""
        if isinstance(by.atom, Comparison):
            side = limit_side(by.atom)
            term, limit = side or (by.atom.left, None)
            actual = float(
                np.broadcast_to(value_of(term, values), (len(self._trace.times_s),))[index]
            )
            unit = unit_text(term, self._kinds) or unit_text(by.atom.right, self._kinds)
        strictly = is_strict(by)
        return self.verdict(
            passed=found.value > 0.0 or (found.value == 0.0 and not strictly),
            actual=actual if actual is not None and np.isfinite(actual) else None,
            limit=limit,
            unit=unit,
            margin=found.value,
            at_s=self._trace.times_s[index],
        )

    def _add_row(self, t_s: float) -> None:
        if not self.stages.open:
            return
        for name, signal in self._used.items():
            if signal.of_silence:
                since_s = self._heard_s if self._heard_s is not None else self.stages.begin_s
                self._trace.note(name, max(0.0, t_s - (since_s or 0.0)))
        self._trace.add_row(t_s)

    def _times_s(self) -> list[float]:
        """Return the times of the rows; the first one counts from the window's beginning on."""
        times_s = self._trace.times_s.tolist()
        begin_s = self.stages.begin_s
        return times_s if begin_s is None else [min(begin_s, times_s[0]), *times_s[1:]]


def _read(
    terms: Terms, text: str, context: OracleContext, judge: Oracle
) -> tuple[Formula, dict[str, Signal]]:
    signals = signals_of(context, judge.stages)
    try:
        formula = parse_stl(text)
        require_sound(formula, {name: signal.kind for name, signal in signals.items()})
    except StlError as error:
        raise OracleError(
            f"oracle {terms.name!r}: {error}",
            key="stl",
            offset=error.offset,
            suggestion=error.suggestion,
        ) from error
    return formula, signals


def _of_both(parameters: StlParameters) -> bool:
    try:
        names = names_of(parse_stl(parameters.stl))
    except StlError:
        return False
    return any(name.name == TWIN_DISTANCE_NAME for name in names)


@oracle(
    "stl",
    "has a formula of signal temporal logic hold over the signals of the run",
    StlParameters,
    pair_only=_of_both,
    window=ON_GOAL,
)
def stl(terms: Terms, parameters: StlParameters, context: OracleContext) -> Oracle:
    """Return the oracle of a formula. Raises OracleError with the place of a mistake in it."""
    return Stl(terms, text=parameters.stl, context=context)
