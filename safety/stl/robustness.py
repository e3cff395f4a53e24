"""How far an STL formula holds over recorded values: its quantitative semantics, by rtamt.

Signals are constant from one sample to the next, and the last value lasts on, so that every
formula has a value whenever the recording ends. Temporal and boolean structure goes to rtamt's
offline monitor of dense time; it gets one signal for each comparison, which is the difference of
its two sides (Maler and Nickovic 2004; Donze and Maler 2010). rtamt's online monitors are not
used: of 1500 random formulas they refuse or get wrong 900, the offline one none.
"""

import itertools
import sys
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safety.stl.formula import (
    Absolute,
    Atom,
    Calculation,
    Comparison,
    Formula,
    Holds,
    Interval,
    Junctor,
    Name,
    Not,
    Number,
    Temporal,
    Term,
    Until,
    horizon_s,
)

Values = NDArray[np.float64]
_ARITHMETIC: dict[str, Callable[[Values, Values], Values]] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
}
_FAR = 1e12
"""Stands for infinity: rtamt's arithmetic stays finite."""


@dataclass(frozen=True, slots=True)
class Occurrence:
    """One place of a comparison in a formula. positive: the formula holds the more, the more it."""

    atom: Atom
    positive: bool


@dataclass(frozen=True, slots=True)
class Robustness:
    """The value of a formula at the beginning.

    value: positive when it holds, negative when not. decided_by: the comparison whose value it
    is, and from which sample on; None when none is.
    """

    value: float
    decided_by: tuple[Occurrence, int] | None


class StlMonitor:
    """Evaluates one formula over values."""

    def __init__(self, formula: Formula) -> None:
        self._occurrences: list[Occurrence] = []
        self._text = self._written(formula, positive=True)
        self._horizon_s = horizon_s(formula)

    def values(self, signals: Mapping[str, Values]) -> tuple[Values, ...]:
        """Return the robustness of each comparison at each sample."""
        return tuple(_atom(one.atom, signals) for one in self._occurrences)

    def robustness(
        self, times_s: Sequence[float], signals: Mapping[str, Values], end_s: float
    ) -> Robustness:
        """Return the robustness at times_s[0] of what was recorded up to end_s."""
        values = self.values(signals)
        lasting = [float(value[-1]) for value in values]
        found = self._evaluate(times_s, values, end_s, lasting)
        return Robustness(found, self._decider(found, values))

    def at_best(
        self, times_s: Sequence[float], signals: Mapping[str, Values], end_s: float
    ) -> float:
        """Return the robustness if all went as well as can be from end_s on."""
        values = self.values(signals)
        if not any(self._speaks_against(i, value) for i, value in enumerate(values)):
            return _FAR
        best = [_FAR if one.positive else -_FAR for one in self._occurrences]
        return self._evaluate(times_s, values, end_s, best)

    def _speaks_against(self, index: int, value: Values) -> bool:
        sign = 1.0 if self._occurrences[index].positive else -1.0
        return bool(np.min(sign * value) <= 0.0)

    def _evaluate(
        self,
        times_s: Sequence[float],
        values: Sequence[Values],
        end_s: float,
        afterwards: Sequence[float],
    ) -> float:
        specification = _rtamt().StlDenseTimeSpecification()
        for index in range(len(values)):
            specification.declare_var(f"x{index}", "float")
        specification.spec = self._text
        specification.parse()
        begin_s = times_s[0]
        end_s = max(end_s, times_s[-1])
        last_s = end_s - begin_s + self._horizon_s + 1.0
        series = [
            [f"x{i}", _steps(times_s, value, afterwards[i], end_s, last_s)]
            for i, value in enumerate(values)
        ]
        value: float = specification.evaluate(*series)[0][1]
        return value

    def _decider(self, found: float, values: Sequence[Values]) -> tuple[Occurrence, int] | None:
        hits: list[tuple[int, int]] = []
        for number, (one, value) in enumerate(zip(self._occurrences, values, strict=True)):
            equal = np.flatnonzero((value if one.positive else -value) == found)
            hits += [(int(equal[0]), number)] if equal.size else []
        if not hits:
            return None
        index, number = min(hits)
        return self._occurrences[number], index

    def _written(self, formula: Formula, *, positive: bool) -> str:
        """Return the formula as rtamt reads it, all in parentheses, each comparison a signal."""
        match formula:
            case Comparison() | Holds():
                self._occurrences.append(Occurrence(formula, positive))
                return f"(x{len(self._occurrences) - 1} >= 0)"
            case Not(inner):
                return f"(not {self._written(inner, positive=not positive)})"
            case Temporal(word, interval, inner):
                return f"({word}{_span(interval)} {self._written(inner, positive=positive)})"
            case Until(interval, left, right):
                held = self._written(left, positive=positive)
                reached = self._written(right, positive=positive)
                return f"({held} until{_span(interval)} {reached})"
            case Junctor(word, left, right):
                return self._joined(word, left, right, positive=positive)

    def _joined(self, word: str, left: Formula, right: Formula, *, positive: bool) -> str:
        if word == "iff":
            # Each side with its own sign, so that what is best for it is known.
            forth = self._joined("implies", left, right, positive=positive)
            return f"({forth} and {self._joined('implies', right, left, positive=positive)})"
        if word == "implies":
            premise = self._written(left, positive=not positive)
            return f"((not {premise}) or {self._written(right, positive=positive)})"
        first = self._written(left, positive=positive)
        return f"({first} {word} {self._written(right, positive=positive)})"


def _span(interval: Interval) -> str:
    if interval.until_s is None:
        return ""
    return f"[{interval.from_s:.9f},{interval.until_s:.9f}]"


def _steps(
    times_s: Sequence[float], value: Values, afterwards: float, end_s: float, last_s: float
) -> list[list[float]]:
    """Return [time, value] where the value changes, then what comes after the end."""
    begin_s = times_s[0]
    changes = np.flatnonzero(np.diff(value)) + 1
    kept = itertools.chain([0], changes.tolist())
    steps = [[times_s[i] - begin_s, float(value[i])] for i in kept]
    if afterwards != steps[-1][1]:
        if end_s - begin_s > steps[-1][0]:
            steps.append([end_s - begin_s, afterwards])
        else:
            steps[-1][1] = afterwards
    return [*steps, [last_s, afterwards]]


def _atom(atom: Atom, signals: Mapping[str, Values]) -> Values:
    if isinstance(atom, Holds):
        return signals[atom.name.name] - 0.5
    left, right = value_of(atom.left, signals), value_of(atom.right, signals)
    length = len(next(iter(signals.values())))
    difference = left - right if atom.comparator in {">=", ">"} else right - left
    finite = np.nan_to_num(difference, nan=-_FAR, posinf=_FAR, neginf=-_FAR)
    return np.broadcast_to(finite, (length,))


def value_of(term: Term, signals: Mapping[str, Values]) -> Values:
    """Return the values of a term; what is divided by nothing is infinite, or not a number."""
    match term:
        case Number(value):
            return np.array(value)
        case Name(name):
            return signals[name]
        case Absolute(inner):
            return np.abs(value_of(inner, signals))
        case Calculation(operator, left, right):
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                both = value_of(left, signals), value_of(right, signals)
                return np.asarray(_ARITHMETIC[operator](*both))


def is_strict(occurrence: Occurrence) -> bool:
    """Return whether a value of exactly 0 is against the formula."""
    atom = occurrence.atom
    strict = isinstance(atom, Comparison) and atom.comparator in {">", "<"}
    return strict is occurrence.positive


def _rtamt() -> Any:
    """Return rtamt; imported when a formula is evaluated, for it takes 0.15 s."""
    # antlr4 4.7, which rtamt needs, imports typing.io, which warns, and is gone in Python 3.13.
    sys.modules["typing.io"] = typing
    import rtamt  # noqa: PLC0415  # see above

    return rtamt


def limit_side(atom: Comparison) -> tuple[Term, float] | None:
    """Return the side that was measured and the number on the other; None without a number."""
    match atom.left, atom.right:
        case (measured, Number(value)):
            return measured, value
        case (Number(value), measured):
            return measured, value
    return None
