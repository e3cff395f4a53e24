"""Robustness of an STL formula over recorded values: quantitative semantics in dense time.

Signals are piecewise constant: a value lasts from its sample to the next one, and the last one
without end, so that every formula has a value whenever the recording ends. Robustness is that of
Donze and Maler ("Robust satisfaction of temporal logic over real-valued signals", 2010): a
comparison is the difference of its sides, `and` and `always` are the minimum, `or` and
`eventually` the maximum, over closed intervals. Operators of the past look back to the beginning
of the window at most; an interval that is not given ends with the window.

- A boolean signal has no distance: its robustness is plus or minus infinity.
- If a formula has comparisons of different units, each is divided by its limit (by 1 in its unit
  if the limit is 0 or a signal), so that metres are never compared with metres per second.
- A formula that needs a value which is missing or not finite cannot be evaluated.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from wil_campaign.plugins.stl.formula import Formula, JunctorFormula
from wil_campaign.plugins.stl.robustness import (
    ZERO,
    AtomOccurrence,
    FormulaEvaluation,
    SignalRecording,
    UnevaluableError,
    UnevaluableFormula,
)
from wil_campaign.plugins.stl.steps import Values


@dataclass(frozen=True, slots=True)
class FormulaRobustness:
    """The robustness of an STL formula at the beginning of the window.

    value: positive when it holds, negative when not; infinite where boolean signals
    decide. holds: tells < from <= where the value is 0. decided_by: the atom that decides,
    None where none does; index: the sample with its value. unmet: the implications whose premise
    never held: they hold, and say nothing of what was recorded.
    """

    value: float
    holds: bool
    decided_by: AtomOccurrence | None
    index: int
    unmet: tuple[JunctorFormula, ...] = ()


class StlMonitor:
    """Evaluates one STL formula's robustness. mixed: comparisons of different units."""

    def __init__(self, formula: Formula, *, mixed: bool = False) -> None:
        self._formula = formula
        self._mixed = mixed

    def robustness(
        self, times_s: Sequence[float], signals: Mapping[str, Values], end_s: float
    ) -> FormulaRobustness | UnevaluableFormula:
        """Return the robustness at times_s[0] of what was recorded up to end_s."""
        found = self._evaluate_formula(times_s, signals, end_s, best_after=False)
        if isinstance(found, FormulaRobustness) and found.decided_by is None:
            return UnevaluableFormula(
                "the formula", times_s[0], "looks back to before its window, which begins"
            )
        return found

    def at_best(
        self,
        times_s: Sequence[float],
        signals: Mapping[str, Values],
        end_s: float,
        at_s: float | None = None,
    ) -> FormulaRobustness | UnevaluableFormula:
        """Return the best robustness still possible after end_s, at at_s in place of times_s[0]."""
        return self._evaluate_formula(times_s, signals, end_s, best_after=True, at_s=at_s)

    def lost_s(self, times_s: Sequence[float], signals: Mapping[str, Values]) -> float | None:
        """Return the sample from which on the formula fails, whatever follows; None without one.

        None too where only the end of the recording decides, as of an `eventually` with no limit.
        """
        first, after = 0, len(times_s)
        while first < after:
            middle = (first + after) // 2
            seen = {name: values[: middle + 1] for name, values in signals.items()}
            # A sample counts only when time has advanced by one nanosecond of the recording's axis.
            best = self.at_best(times_s[: middle + 1], seen, times_s[middle] + 1e-9)
            if isinstance(best, FormulaRobustness) and not best.holds:
                after = middle
            else:
                first = middle + 1
        return times_s[first] if first < len(times_s) else None

    def _evaluate_formula(
        self,
        times_s: Sequence[float],
        signals: Mapping[str, Values],
        end_s: float,
        *,
        best_after: bool,
        at_s: float | None = None,
    ) -> FormulaRobustness | UnevaluableFormula:
        """Return the formula's robustness over recorded values, or why none."""
        recording = SignalRecording(
            times_s, signals, end_s=end_s, mixed=self._mixed, best_after=best_after
        )
        evaluation = FormulaEvaluation(recording)
        try:
            value, by, index = evaluation.at(self._formula, times_s[0] if at_s is None else at_s)
        except UnevaluableError as error:
            return error.found
        return FormulaRobustness(
            0.0 if abs(value) <= ZERO else value, value > 0.0, by, index, evaluation.unmet
        )
