"""Follows in flight the best that an STL formula can still reach.

What is settled is not looked at again, so that a look costs no more after an hour.
"""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from wil_campaign.plugins.stl.deciding_part import DecidingPart, deciding_part_of
from wil_campaign.plugins.stl.formula import (
    Formula,
    JunctorFormula,
    StlInterval,
    TemporalFormula,
    looks_back_s,
    seen_ahead_s,
)
from wil_campaign.plugins.stl.monitor import FormulaRobustness, StlMonitor
from wil_campaign.plugins.stl.robustness import UnevaluableFormula
from wil_campaign.plugins.stl.steps import Values
from wil_campaign.plugins.stl.stl_trace import FIRST_WITHIN_S, StlTrace
from wil_campaign.plugins.stl.units import SignalKind

_SETTLED_S = 1.0
"""How long after its value at a time is known that time is not looked at again."""


@dataclass(frozen=True, slots=True)
class BestReached:
    """The robustness that a formula can reach, with its deciding part and that sample's time."""

    reached: FormulaRobustness
    part: DecidingPart | None
    at_s: float

    @property
    def margin(self) -> tuple[float, bool]:
        """Return the robustness so that < counts as less than <= at the limit."""
        return self.reached.value, self.reached.holds


def best_reached(
    found: FormulaRobustness,
    times_s: Sequence[float],
    values: Mapping[str, Values],
    kinds: Mapping[str, SignalKind],
) -> BestReached:
    """Return a robustness with its deciding part; times_s, values: what it was evaluated over."""
    by = found.decided_by
    part = None if by is None else deciding_part_of(by, found.index, values, kinds)
    return BestReached(found, part, times_s[found.index])


class FormulaWatch:
    """Follows one STL formula: each of the formulas that it joins by `and` on its own."""

    def __init__(self, formula: Formula, *, mixed: bool, kinds: Mapping[str, SignalKind]) -> None:
        self._joined = [_Joined(one, mixed, kinds) for one in _joined_by_and(formula)]

    @property
    def is_whole(self) -> bool:
        """Return whether each look is at the whole flight: nothing is ever settled."""
        return any(one.is_whole for one in self._joined)

    def best(self, trace: StlTrace) -> BestReached | UnevaluableFormula:
        """Return the best that the formula can still reach.

        A sample of a time before now may come yet: nothing is known after the last one.
        """
        found = [one.best(trace) for one in self._joined]
        for one in found:
            if isinstance(one, UnevaluableFormula):
                return one
        reached = [one for one in found if isinstance(one, BestReached)]
        return min(reached, key=lambda one: one.margin)


def _joined_by_and(formula: Formula) -> Iterator[Formula]:
    match formula:
        case JunctorFormula("and", left, right):
            yield from _joined_by_and(left)
            yield from _joined_by_and(right)
        case _:
            yield formula


class _Joined:
    """Follows one of the formulas that are joined by `and`.

    An `always` whose inner formula is decided within a time: from its first row that is not. Other
    formulas: whole, until they are decided.
    """

    def __init__(self, formula: Formula, mixed: bool, kinds: Mapping[str, SignalKind]) -> None:
        self._kinds = kinds
        self._ahead_s, self._back_s = seen_ahead_s(formula), math.inf
        self._is_always = False
        match formula:
            case TemporalFormula("always", StlInterval(0.0, None), inner):
                ahead_s, back_s = seen_ahead_s(inner), looks_back_s(inner)
                if math.isfinite(ahead_s + back_s):
                    self._ahead_s, self._back_s, self._is_always = ahead_s, back_s, True
        self._monitor = StlMonitor(formula, mixed=mixed)
        self._row = 0
        """The first row that is not settled."""
        self._least: BestReached | None = None
        """Of the rows before, at least."""
        self._settled: BestReached | UnevaluableFormula | None = None

    @property
    def is_whole(self) -> bool:
        return math.isinf(self._ahead_s)

    def best(self, trace: StlTrace) -> BestReached | UnevaluableFormula:
        if self._settled is None:
            return self._look(trace)
        return self._settled

    def _look(self, trace: StlTrace) -> BestReached | UnevaluableFormula:
        times_s = trace.times_s
        at_s = times_s[self._row]
        first = max(0, bisect_right(times_s, at_s - self._back_s) - 1)
        seen_s, values = times_s[first:], trace.values(first)
        found = self._monitor.at_best(seen_s, values, seen_s[-1] + 1e-9, at_s)
        settled_s = times_s[-1] - self._ahead_s - _SETTLED_S
        if isinstance(found, UnevaluableFormula):
            if found.at_s is not None and found.at_s < settled_s - FIRST_WITHIN_S:
                self._settled = found
            return found
        best = best_reached(found, seen_s, values, self._kinds)
        if self._is_always:
            if self._least is not None:
                best = min(self._least, best, key=lambda one: one.margin)
            self._least = best
            self._row = max(self._row, bisect_left(times_s, settled_s) - 1)
        elif times_s[0] <= settled_s:
            self._settled = best
        return best
