"""The oracle of an STL formula over the signals of a run; its margin is the robustness.

The limits that a formula holds: comparisons of a signal with a number, under `always` and `and`.

A condition that may hold at some time has no limit.
"""

import re
from collections.abc import Collection, Iterator, Mapping
from typing import Annotated, ClassVar

from pydantic import Field

from wil_campaign.foundation.files.documents import Data
from wil_campaign.plugins.stl.arithmetic import limit_side, written_atom
from wil_campaign.plugins.stl.deciding_part import deciding_part_of
from wil_campaign.plugins.stl.formula import (
    ConstantTerm,
    Formula,
    JunctorFormula,
    SignalTerm,
    StlComparison,
    StlError,
    TemporalFormula,
    first_needed_s,
    signal_names_of,
)
from wil_campaign.plugins.stl.formula_watch import BestReached, FormulaWatch, best_reached
from wil_campaign.plugins.stl.monitor import FormulaRobustness, StlMonitor
from wil_campaign.plugins.stl.parser import parse_stl
from wil_campaign.plugins.stl.robustness import UnevaluableFormula
from wil_campaign.plugins.stl.stl_signals import (
    TWIN_DISTANCE_NAME,
    FenceMarginSignal,
    PairDistanceSignal,
    StlSignal,
    motion_needs_of,
    reports_of,
    signal_docs,
    signals_of,
)
from wil_campaign.plugins.stl.stl_trace import StlTrace
from wil_campaign.plugins.stl.units import has_several_units, require_sound
from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.safety.model.samples import (
    FenceSample,
    LinkSample,
    PoseSample,
    ReferenceSample,
    StageSample,
    StateSample,
)
from wil_campaign.safety.model.signals import distance_name
from wil_campaign.safety.oracles.oracle import (
    NO_FLAGS,
    Flags,
    Oracle,
    OracleContext,
    OracleError,
    OracleTerms,
    OwnKey,
    SignalLimit,
    Windowed,
    oracle,
)
from wil_campaign.safety.oracles.oracle_terms import ON_GOAL, StageTracker


def limits_of_formula(part: Mapping[str, Data]) -> Iterator[SignalLimit]:
    """Yield the limits that the formula of an oracle's parameters holds; none for a bad one."""
    try:
        formula = parse_stl(str(part.get("stl")))
    except (StlError, RecursionError):
        return
    for comparison, from_s, until_s in _always(formula, 0.0, 0.0):
        measured, limit = limit_side(comparison)
        if isinstance(measured, SignalTerm) and isinstance(limit, ConstantTerm):
            is_left = measured is comparison.left
            yield SignalLimit(
                signal=measured.name,
                value=limit.value,
                is_upper=(comparison.comparator in {"<=", "<"}) == is_left,
                from_s=from_s,
                until_s=until_s,
                text=written_atom(comparison),
            )


def _always(
    formula: Formula, from_s: float, until_s: float | None
) -> Iterator[tuple[StlComparison, float, float | None]]:
    """Yield comparisons that must hold, with the interval in the window; None: to its end."""
    match formula:
        case StlComparison():
            yield formula, from_s, until_s
        case TemporalFormula("always", interval, inner):
            is_open = until_s is None or interval.until_s is None
            last_s = None if is_open else (until_s or 0.0) + (interval.until_s or 0.0)
            yield from _always(inner, from_s + interval.from_s, last_s)
        case JunctorFormula("and", left, right):
            yield from _always(left, from_s, until_s)
            yield from _always(right, from_s, until_s)
        case _:
            pass


_CHECK_EVERY_S = 1.0
"""How often a formula is evaluated in flight..."""
_CHECK_SHARE = 0.01
"""... and that where each evaluation looks at the whole flight: a share of the time flown."""


class StlParameters(Windowed):
    """stl: the formula; its times count from the stage that opens the window."""

    stl: Annotated[
        str, Field(description='the formula, such as "always[0,30] (clearance_m >= 0.1)"')
    ]


class StlOracle(Oracle):
    """The oracle of an STL formula from the stage that opens its window on.

    actual, limit, unit, margin, at_s: of the comparison that decides; a margin of 0 of a strict
    comparison fails. INVALID where a signal has no value when the formula needs it.
    """

    is_certain: ClassVar[bool] = True

    def __init__(self, terms: OracleTerms, *, text: str, context: OracleContext) -> None:
        super().__init__(terms)
        self._formula, self._signals = _read_formula(terms, text, context, self.stages)
        self._kinds = {name: signal.kind for name, signal in self._signals.items()}
        names = tuple(dict.fromkeys(name.name for name in signal_names_of(self._formula)))
        self._used = {name: self._signals[name] for name in names}
        self.reports = reports_of(names)
        self.motion = motion_needs_of(names)
        self._trace = StlTrace(names)
        mixed = has_several_units(self._formula, self._kinds)
        self._monitor = StlMonitor(self._formula, mixed=mixed)
        self._pair_distance = PairDistanceSignal()
        self._judged: PoseSample | None = None
        self._last_sample_s: float | None = None
        self._next_check_s = 0.0
        self._watch = FormulaWatch(self._formula, mixed=mixed, kinds=self._kinds)
        self._flagged = False
        self._so_far: OracleResult | None = None
        self._next_look_s = 0.0
        self._looked_at = 0

    @property
    def watches(self) -> tuple[str, ...]:
        """Return both vehicles where the STL formula has the distance between them."""
        both = any(signal.of_both for signal in self._used.values())
        return ("real", "twin") if both else (self.vehicle,)

    def on_pose(self, sample: PoseSample) -> Flags:
        """Record a pose of either vehicle for the formula; one of the judged vehicle adds a row."""
        pair_distance_m = self._pair_distance.observe(sample)
        if sample.vehicle != self.vehicle:
            return NO_FLAGS
        self._judged = sample
        for name, signal in self._used.items():
            if signal.of_pose is not None:
                self._trace.note(name, signal.of_pose(sample))
            elif signal.of_both:
                self._trace.note(name, pair_distance_m)
        if self.stages.covers(sample.t_s):
            self._add_row(sample.t_s)
        return NO_FLAGS

    def on_state(self, sample: StateSample) -> Flags:
        """Record a state for the formula: a row as well, for formulas without poses."""
        if sample.vehicle != self.vehicle:
            return NO_FLAGS
        for name, signal in self._used.items():
            if signal.of_state is not None:
                self._trace.note(name, signal.of_state(sample))
        if self.stages.open:
            self._add_row(sample.t_s)
        return NO_FLAGS

    def on_reference(self, sample: ReferenceSample) -> Flags:
        """Record a pose by another source for the formula, as the vehicle's estimate."""
        if sample.vehicle != self.vehicle or self._judged is None:
            return NO_FLAGS
        for name, signal in self._used.items():
            if signal.of_reference is not None:
                value = signal.of_reference(self._judged, sample)
                if value is not None:
                    self._trace.note(name, value)
        return NO_FLAGS

    def on_received(self, sample: LinkSample) -> Flags:
        """Record a sign of life for the STL formula."""
        if sample.vehicle == self.vehicle:
            self._last_sample_s = sample.t_s
        return NO_FLAGS

    def on_stage(self, sample: StageSample) -> Flags:
        """Record a stage: the formula's window begins with the values known when it opens."""
        opened = not self.stages.open
        flags = super().on_stage(sample)
        self._so_far = None
        if opened and self.stages.open:
            self._add_row(sample.t_s)
        return flags

    def on_fence(self, sample: FenceSample) -> Flags:
        """Record the vehicle's changed fence for the STL formula."""
        for signal in self._used.values():
            if sample.vehicle == self.vehicle and isinstance(signal.of_pose, FenceMarginSignal):
                signal.of_pose.fence = sample.fence
        return NO_FLAGS

    def on_tick(self, t_s: float) -> Flags:
        """Check whether the STL formula can still hold, if it is to fail fast."""
        due = self.terms.fail_fast and not self._flagged and t_s >= self._next_check_s
        if not due or not self.stages.open or not self._trace.times_s:
            return NO_FLAGS
        self._next_check_s = self._next_s(t_s)
        best = self._watch.best(self._trace)
        if isinstance(best, UnevaluableFormula) or best.reached.holds:
            return NO_FLAGS
        self._flagged = True
        text = f"{self.vehicle}: {self.name} cannot be satisfied any more"
        if best.part is not None:
            text += f": {best.part.violation}"
        return self.flag(t_s, text)

    def _next_s(self, t_s: float) -> float:
        flown_s = t_s - self._trace.times_s[0] if self._watch.is_whole else 0.0
        return t_s + max(_CHECK_EVERY_S, flown_s * _CHECK_SHARE)

    def result(self, t_s: float) -> OracleResult:
        """Return the STL formula's robustness over the recorded window."""
        found = self.evaluated(t_s)
        if isinstance(found, UnevaluableFormula):
            return self.invalid(str(found), at_s=found.at_s)
        beside = _unmet_text(found) if found.holds else ""
        if found.decided_by is None:
            return self.verdict(passed=found.holds, detail=beside)
        times_s, values = self._trace.times_s, self._trace.values()
        part = deciding_part_of(found.decided_by, found.index, values, self._kinds)
        # A failure has the time from which on it was certain, not that of the deciding sample.
        at_s = times_s[found.index] if found.holds else self._monitor.lost_s(times_s, values)
        return self.verdict(
            passed=found.holds,
            actual=part.actual,
            limit=part.limit,
            unit=part.unit,
            margin=part.margin,
            at_s=at_s,
            detail=beside if found.holds else part.violation,
        )

    def so_far(self, t_s: float) -> OracleResult:
        """Return the best that the formula can still reach, as of the last look at it.

        Of an `always` that is its least margin so far. A FAIL is certain: what is still open passes
        until it is decided.
        """
        rows = len(self._trace.times_s)
        if not rows:
            return self.invalid("its window has not begun")
        is_final = self.stages.end_s is not None and rows == self._looked_at
        if self._so_far is None or (t_s >= self._next_look_s and not is_final):
            self._next_look_s, self._looked_at = self._next_s(t_s), rows
            self._so_far = self._best_so_far(t_s)
        return self._so_far

    def _best_so_far(self, t_s: float) -> OracleResult:
        is_over = self.stages.end_s is not None
        best = self._at_end(t_s) if is_over else self._watch.best(self._trace)
        if isinstance(best, UnevaluableFormula):
            return self.invalid(str(best), at_s=best.at_s)
        holds, part = best.reached.holds, best.part
        if part is None:
            return self.verdict(passed=holds, detail="decided at the end")
        return self.verdict(
            passed=holds,
            actual=part.actual,
            limit=part.limit,
            unit=part.unit,
            margin=part.margin,
            at_s=best.at_s,
            detail="" if holds else part.violation,
        )

    def _at_end(self, t_s: float) -> BestReached | UnevaluableFormula:
        found = self.evaluated(t_s)
        if isinstance(found, UnevaluableFormula):
            return found
        return best_reached(found, self._trace.times_s, self._trace.values(), self._kinds)

    def evaluated(self, t_s: float) -> FormulaRobustness | UnevaluableFormula:
        """Return the STL robustness as of t_s, or why it cannot be evaluated."""
        if not self._trace.times_s:
            return UnevaluableFormula(
                "the formula", None, "was not evaluated: its window never began"
            )
        end_s = self.stages.end_s if self.stages.end_s is not None else t_s
        begin_s = self._trace.times_s[0]
        for atom, needed_s in first_needed_s(self._formula):
            if begin_s + needed_s > end_s:
                # Its last value would decide for a time that was not observed.
                reason = f"is needed from {begin_s + needed_s:.3f} s on, and its window ended"
                return UnevaluableFormula(written_atom(atom), end_s, reason)
        return self._monitor.robustness(self._trace.times_s, self._trace.values(), end_s)

    def _add_row(self, t_s: float) -> None:
        for name, signal in self._used.items():
            if signal.of_silence:
                since_s = (
                    self._last_sample_s if self._last_sample_s is not None else self.stages.begin_s
                )
                self._trace.note(name, max(0.0, t_s - (since_s or 0.0)))
        self._trace.add_row(t_s)


def _unmet_text(found: FormulaRobustness) -> str:
    """Return which implications of a formula say nothing of the run; empty for none."""
    columns = sorted({formula.at + 1 for formula in found.unmet})
    places = " and ".join(f"column {column}" for column in columns)
    return f"the premise of the implication at {places} never held" if places else ""


def _read_formula(
    terms: OracleTerms, text: str, context: OracleContext, stages: StageTracker
) -> tuple[Formula, dict[str, StlSignal]]:
    """Return the STL formula and its signals. Raises OracleError."""
    signals = signals_of(context, stages)
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
    """Return whether an STL formula uses the distance between both vehicles."""
    try:
        names = signal_names_of(parse_stl(parameters.stl))
    except StlError:
        return False
    return any(name.name == TWIN_DISTANCE_NAME for name in names)


def _named_objects(parameters: StlParameters, objects: Collection[str]) -> Iterator[str]:
    """Yield the objects to which a formula has the distance."""
    words = set(re.findall(r"\w+", parameters.stl))
    yield from (one for one in objects if distance_name(one) in words)


@oracle(
    "stl",
    "satisfies a formula of signal temporal logic over the run's signals",
    StlParameters,
    pair_only=_of_both,
    window=ON_GOAL,
    own_key=OwnKey("stl", "a formula", "A formula of signal temporal logic that has to hold."),
    objects=_named_objects,
    limits=limits_of_formula,
    without_world=lambda given: ("any thing", *re.findall(r"\bdistance_(\w+)_m\b", given.stl)),
    signals=lambda: {name: (kind.unit, kind.meaning) for name, kind in signal_docs().items()},
)
def stl(terms: OracleTerms, parameters: StlParameters, context: OracleContext) -> Oracle:
    """Return the oracle of an STL formula. Raises OracleError with the place of a mistake."""
    return StlOracle(terms, text=parameters.stl, context=context)
