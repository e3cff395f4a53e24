"""Evaluates the robustness of an STL formula and its parts over recorded samples.

Each part is evaluated only at the times at which the formula needs it, so that values missing at
other times do not matter.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wil_campaign.plugins.stl.arithmetic import comparison_margin, margin_scale_of, written_term
from wil_campaign.plugins.stl.formula import (
    FORMULAS,
    Atom,
    BooleanAtom,
    Formula,
    JunctorFormula,
    NegatedFormula,
    Node,
    StlComparison,
    StlInterval,
    TemporalFormula,
    UntilFormula,
    formula_children,
    signal_names_of,
)
from wil_campaign.plugins.stl.steps import (
    NEVER_NS,
    NO_ORIGIN,
    Indices,
    StepFunction,
    Values,
    higher_steps,
    highest_within,
    implied_steps,
    lower_steps,
    steps_held_until,
)

ZERO = float(np.finfo(np.float64).tiny)
"""The robustness of a comparison at its very limit, negative where it is violated there: minimum
and maximum then tell < from <=."""


@dataclass(frozen=True, slots=True)
class AtomOccurrence:
    """An occurrence of an atom in an evaluated formula. positive: robustness grows with it."""

    atom: Atom
    positive: bool


@dataclass(frozen=True, slots=True)
class UnevaluableFormula:
    """A formula that cannot be evaluated. signal: the one at fault; at_s: since when.

    at_s is on the time axis of the samples, None where there are none. problem: "has no value".
    """

    signal: str
    at_s: float | None
    problem: str

    def __str__(self) -> str:
        """Return why the formula cannot be evaluated as a sentence."""
        when = "" if self.at_s is None else f" at {self.at_s:.3f} s"
        return f"{self.signal} {self.problem}{when}"


class UnevaluableError(Exception):
    """Ends the evaluation of a formula that has no value."""

    def __init__(self, found: UnevaluableFormula) -> None:
        super().__init__(str(found))
        self.found = found


class SignalRecording:
    """The recorded signals for an evaluation, on a nanosecond axis from the first sample.

    end_ns: the end of the known values. best_after: the best possible values are taken after it;
    else the last values continue. mixed: the formula compares values of several units.
    """

    def __init__(
        self,
        times_s: Sequence[float],
        signals: Mapping[str, Values],
        *,
        end_s: float,
        mixed: bool,
        best_after: bool,
    ) -> None:
        self.begin_s = times_s[0]
        self.times_ns = np.rint((np.asarray(times_s) - self.begin_s) * 1e9).astype(np.int64)
        self.end_ns = max(_ns(end_s - self.begin_s), int(self.times_ns[-1]))
        self.signals = signals
        self.mixed = mixed
        self.best_after = best_after

    def rows(self, from_ns: int, until_ns: int) -> slice:
        """Return the recorded rows that hold the values between two times, both included."""
        first, last = np.searchsorted(self.times_ns, [from_ns, until_ns], side="right")
        return slice(int(first) - 1, int(last))

    def require_finite(self, name: str, values: Values, rows: slice, problem: str) -> None:
        """Raise UnevaluableError for the first recorded value that is not finite."""
        wrong = np.flatnonzero(~np.isfinite(values[rows]))
        if wrong.size:
            at_ns = int(self.times_ns[rows.start + int(wrong[0])])
            raise UnevaluableError(UnevaluableFormula(name, self.begin_s + at_ns / 1e9, problem))


class FormulaEvaluation:
    """The evaluation of one formula's robustness over one recording.

    Origins are occurrence * samples + sample.
    """

    def __init__(self, recording: SignalRecording) -> None:
        self._recording = recording
        self._occurrences: list[AtomOccurrence] = []
        self._known: dict[tuple[int, bool], StepFunction] = {}
        self._unmet: list[JunctorFormula] = []

    @property
    def unmet(self) -> tuple[JunctorFormula, ...]:
        """Return the implications whose premise held at no time at which it was asked for."""
        return tuple(self._unmet)

    def at(self, formula: Formula, at_s: float) -> tuple[float, AtomOccurrence | None, int]:
        """Return the robustness, the deciding atom and sample. Raises UnevaluableError."""
        at_ns = _ns(at_s - self._recording.begin_s)
        found = self._of(formula, (at_ns, at_ns), positive=True)
        value, origin = float(found.values[0]), int(found.origins[0])
        if origin == NO_ORIGIN:
            return value, None, 0
        number, index = divmod(origin, len(self._recording.times_ns))
        return value, self._occurrences[number], index

    def _of(self, formula: Formula, span_ns: tuple[int, int], *, positive: bool) -> StepFunction:
        """Return the robustness of a subformula over a span, both ends included.

        positive: whether the robustness of the whole grows with it. Each part is
        needed for one span only; `iff` needs both signs.
        """
        key = id(formula), positive
        if key not in self._known:
            self._known[key] = self._evaluate_node(formula, span_ns, positive=positive)
        return self._known[key]

    def _evaluate_node(  # noqa: PLR0911  # one for each kind of node
        self, formula: Formula, span_ns: tuple[int, int], *, positive: bool
    ) -> StepFunction:
        match formula:
            case StlComparison() | BooleanAtom():
                return self._atom(formula, span_ns, positive=positive)
            case NegatedFormula(inner):
                return self._of(inner, span_ns, positive=not positive).negated()
            case TemporalFormula("always" | "eventually"):
                return self._ahead(formula, span_ns, positive=positive)
            case TemporalFormula():
                return self._back(formula, span_ns, positive=positive)
            case UntilFormula():
                return self._until(formula, span_ns, positive=positive)
            case JunctorFormula("and" | "or" as word, left, right):
                first = self._of(left, span_ns, positive=positive)
                second = self._of(right, span_ns, positive=positive)
                return lower_steps(first, second) if word == "and" else higher_steps(first, second)
            case JunctorFormula(word, left, right):
                forth = self._evaluate_implication(left, right, span_ns, positive=positive)
                if word == "implies":
                    if not np.any(self._of(left, span_ns, positive=not positive).values > 0.0):
                        self._unmet.append(formula)
                    return forth
                return lower_steps(
                    forth, self._evaluate_implication(right, left, span_ns, positive=positive)
                )

    def _evaluate_implication(
        self, premise: Formula, conclusion: Formula, span_ns: tuple[int, int], *, positive: bool
    ) -> StepFunction:
        return implied_steps(
            self._of(premise, span_ns, positive=not positive),
            self._of(conclusion, span_ns, positive=positive),
            positive=positive,
        )

    def _ahead(
        self, node: TemporalFormula, span_ns: tuple[int, int], *, positive: bool
    ) -> StepFunction:
        from_ns, until_ns = span_ns
        lowest = node.word == "always"
        near_ns, far_ns = _bounds_ns(node.interval)
        end_ns = self._end_ns(node.inner, latest=lowest is not positive)
        last_ns = max(end_ns, until_ns) if far_ns is None else until_ns + far_ns
        inner = self._of(node.inner, (from_ns + near_ns, last_ns), positive=positive)
        if far_ns is None:
            enters_ns = np.where(inner.times_ns <= end_ns, from_ns, inner.times_ns)
        else:
            enters_ns = inner.times_ns - far_ns
        return _extreme(inner, enters_ns, _shift_times(inner.until_ns(), -near_ns), span_ns, lowest)

    def _back(
        self, node: TemporalFormula, span_ns: tuple[int, int], *, positive: bool
    ) -> StepFunction:
        from_ns, until_ns = span_ns
        lowest = node.word == "historically"
        near_ns, far_ns = _bounds_ns(node.interval)
        if until_ns < near_ns:
            return _constant(from_ns, np.inf if lowest else -np.inf)
        first_ns = 0 if far_ns is None else max(0, from_ns - far_ns)
        inner = self._of(node.inner, (first_ns, until_ns - near_ns), positive=positive)
        leaves_ns = _shift_times(inner.until_ns(), NEVER_NS if far_ns is None else far_ns)
        return _extreme(inner, inner.times_ns + near_ns, leaves_ns, span_ns, lowest)

    def _until(
        self, node: UntilFormula, span_ns: tuple[int, int], *, positive: bool
    ) -> StepFunction:
        """Return the robustness of left until[near,far] right.

        It is eventually[near,far] right, and always[0,near] (left until right) (Donze, Ferrere,
        Maler, "Efficient robust monitoring for STL", 2013).
        """
        from_ns, until_ns = span_ns
        near_ns, far_ns = _bounds_ns(node.interval)
        end_ns = max(
            self._end_ns(node.left, latest=positive), self._end_ns(node.right, latest=positive)
        )
        last_ns = max(end_ns, until_ns) if far_ns is None else until_ns + far_ns
        left = self._of(node.left, (from_ns, last_ns), positive=positive)
        right = self._of(node.right, (from_ns, last_ns), positive=positive)
        if far_ns is None:
            return steps_held_until(left, right, end_ns)
        whole = steps_held_until(left, right, last_ns)
        whole = _extreme(whole, whole.times_ns - near_ns, whole.until_ns(), span_ns, True)
        reached = _extreme(
            right, right.times_ns - far_ns, _shift_times(right.until_ns(), -near_ns), span_ns, False
        )
        return lower_steps(reached, whole)

    def _end_ns(self, inner: Node, *, latest: bool) -> int:
        """Return the end of an interval for the evaluation where none is given.

        For a recording that continues: the end that is best for the formula, now or when all known
        values have left the windows of its past operators.
        """
        recording = self._recording
        past_ns = _past_ns(inner) if recording.best_after and latest else 0
        return recording.end_ns + past_ns

    def _atom(self, atom: Atom, span_ns: tuple[int, int], *, positive: bool) -> StepFunction:
        recording = self._recording
        from_ns, until_ns = span_ns
        number = len(self._occurrences)
        self._occurrences.append(AtomOccurrence(atom, positive))
        rows = recording.rows(from_ns, until_ns)
        values = self._values(atom, rows)
        times_ns = np.maximum(recording.times_ns[rows], from_ns)
        origins = np.arange(rows.start, rows.stop) + number * len(recording.times_ns)
        steps = StepFunction(times_ns, values[rows], origins).compressed()
        if not recording.best_after or until_ns < recording.end_ns:
            return steps
        best = _constant(max(from_ns, recording.end_ns), np.inf if positive else -np.inf)
        known = (
            steps.times_ns < recording.end_ns if from_ns < recording.end_ns else np.array([], int)
        )
        return StepFunction(
            np.append(steps.times_ns[known], best.times_ns),
            np.append(steps.values[known], best.values),
            np.append(steps.origins[known], best.origins),
        )

    def _values(self, atom: Atom, rows: slice) -> Values:
        recording = self._recording
        for name in dict.fromkeys(name.name for name in signal_names_of(atom)):
            recording.require_finite(name, recording.signals[name], rows, "has no value")
        if isinstance(atom, BooleanAtom):
            true = recording.signals[atom.name.name] > 0.5
            return np.where(true, np.inf, -np.inf)
        difference = np.broadcast_to(
            comparison_margin(atom, recording.signals), recording.times_ns.shape
        )
        text = f"{written_term(atom.left)} - {written_term(atom.right)}"
        recording.require_finite(text, difference, rows, "is not finite")
        holds = difference > 0.0 if atom.comparator in {">", "<"} else difference >= 0.0
        found = difference / margin_scale_of(atom) if recording.mixed else difference
        return np.where(found == 0.0, np.where(holds, ZERO, -ZERO), found)


def _extreme(
    inner: StepFunction,
    enters_ns: Indices,
    leaves_ns: Indices,
    span_ns: tuple[int, int],
    lowest: bool,
) -> StepFunction:
    """Return the extreme of a subformula's robustness within a moving window."""
    signed = inner.negated() if lowest else inner
    found = highest_within(signed, enters_ns, leaves_ns, *span_ns)
    return found.negated() if lowest else found


def _constant(from_ns: int, value: float) -> StepFunction:
    return StepFunction(np.array([from_ns]), np.array([value]), np.array([NO_ORIGIN]))


def _shift_times(until_ns: Indices, by_ns: int) -> Indices:
    """Return evaluation times shifted; the last one stays never."""
    if by_ns == NEVER_NS:
        return np.full_like(until_ns, NEVER_NS)
    return np.append(until_ns[:-1] + by_ns, NEVER_NS)


def _bounds_ns(interval: StlInterval) -> tuple[int, int | None]:
    """Return an STL interval's bounds in nanoseconds; None for an open end."""
    until_s = interval.until_s
    return _ns(interval.from_s), None if until_s is None else _ns(until_s)


def _past_ns(node: Node) -> int:
    """Return how far an evaluated subformula looks back, by its intervals."""
    own_ns = 0
    if isinstance(node, TemporalFormula) and node.word in {"once", "historically"}:
        own_ns = _bounds_ns(node.interval)[1] or 0
    return own_ns + max(
        (_past_ns(c) for c in formula_children(node) if isinstance(c, FORMULAS)), default=0
    )


def _ns(time_s: float) -> int:
    """Return seconds as whole nanoseconds of the evaluation's axis."""
    return round(time_s * 1e9)
