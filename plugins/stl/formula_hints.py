"""Warnings of `validate`: comparisons of a formula that no flight decides; pure.

The values of a term are an interval (Moore, "Interval analysis", 1966); of a sum each signal counts
once, so that `up_m - up_m` is 0.
"""

import math
from collections.abc import Iterator, Mapping

from wil_campaign.campaigns.schema import Mode
from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.campaigns.setup.case_setup import Case
from wil_campaign.foundation.files.documents import Problem
from wil_campaign.plugins.stl.arithmetic import written_atom
from wil_campaign.plugins.stl.formula import (
    AbsoluteTerm,
    CalculationTerm,
    ConstantTerm,
    Formula,
    SignalTerm,
    StlComparison,
    StlError,
    Term,
    formula_children,
    signal_names_of,
)
from wil_campaign.plugins.stl.parser import parse_stl
from wil_campaign.plugins.stl.stl_oracle import StlParameters
from wil_campaign.plugins.stl.stl_signals import THING_DISTANCE, signal_docs
from wil_campaign.plugins.stl.units import SignalKind

Span = tuple[float, float]
"""The least and the largest value of a term."""

_FARTHEST = {"m": 1e5, "m/s": 1e3, "deg": 1e4, "s": 86_400.0, "V": 1e4}
"""No drone gets so far, by the unit of a signal; a distance to nothing is 100 km."""


def formula_hints(files: CaseFiles, case: Case, _: tuple[Mode, ...]) -> Iterator[Problem]:
    """Yield a warning for each comparison of a formula that holds always, or never."""
    kinds = signal_docs()
    for use in case.oracles:
        if not isinstance(use.parameters, StlParameters):
            continue
        try:
            decided = decided_comparisons(parse_stl(use.parameters.stl), kinds)
        except (StlError, RecursionError):
            continue  # a problem of the campaign
        for atom, holds in decided:
            text = f"'{written_atom(atom)}' holds for {'every' if holds else 'no'} value there is"
            message = f"{text}: no flight decides it"
            yield files.campaign.problem(("oracles", use.name, "stl"), message)


def decided_comparisons(
    formula: Formula, kinds: Mapping[str, SignalKind]
) -> list[tuple[StlComparison, bool]]:
    """Return comparisons whose truth no value of their signals changes, each with that truth.

    Those of signals that another comparison asks for are left out: the lower one of
    0 <= tilt_deg <= 30 is a way to write.
    """
    atoms = [(atom, _truth(atom, kinds)) for atom in _comparisons(formula)]
    asked = {name.name for atom, holds in atoms if holds is None for name in signal_names_of(atom)}
    return [
        (atom, holds)
        for atom, holds in atoms
        if holds is not None and not asked & {name.name for name in signal_names_of(atom)}
    ]


def _comparisons(formula: Formula) -> Iterator[StlComparison]:
    if isinstance(formula, StlComparison):
        yield formula
        return
    for child in formula_children(formula):
        if isinstance(child, Formula):
            yield from _comparisons(child)


def _truth(atom: StlComparison, kinds: Mapping[str, SignalKind]) -> bool | None:
    """Return whether a comparison holds for all values of its signals; None where they decide."""
    more, less = atom.left, atom.right
    if atom.comparator in {"<=", "<"}:
        more, less = less, more
    least, most = _span(CalculationTerm("-", more, less, atom.at), kinds)
    if atom.comparator in {">", "<"}:
        return True if least > 0.0 else False if most <= 0.0 else None
    return True if least >= 0.0 else False if most < 0.0 else None


def _span(term: Term, kinds: Mapping[str, SignalKind]) -> Span:
    """Return the interval of a term's values; one that is not known is infinite, or NaN."""
    summands = _summands(term)
    if summands is None:
        return _span_of_parts(term, kinds)
    at_least = at_most = summands.pop("", 0.0)
    for name, factor in summands.items():
        ends = [factor * end for end in _signal_span(name, kinds)]
        at_least, at_most = at_least + min(ends), at_most + max(ends)
    return at_least, at_most


def _signal_span(name: str, kinds: Mapping[str, SignalKind]) -> Span:
    kind = kinds.get(name, THING_DISTANCE)
    far = _FARTHEST.get(kind.unit, math.inf)
    return max(kind.least, -far), min(kind.most, far)


def _summands(term: Term) -> dict[str, float] | None:
    """Return the factor of each signal of a sum, and at "" its number; None where it is no sum."""
    match term:
        case ConstantTerm(value):
            return {"": value}
        case SignalTerm(name):
            return {name: 1.0}
        case CalculationTerm(operator, left, right):
            return _joined(operator, _summands(left), _summands(right))
        case AbsoluteTerm():
            return None


def _joined(
    operator: str, first: dict[str, float] | None, second: dict[str, float] | None
) -> dict[str, float] | None:
    """Return the summands of a calculation on two sums; None where it is no sum."""
    if first is None or second is None:
        return None
    if operator in {"+", "-"}:
        sign = 1.0 if operator == "+" else -1.0
        names = dict.fromkeys([*first, *second])
        return {name: first.get(name, 0.0) + sign * second.get(name, 0.0) for name in names}
    if operator == "*" and set(first) == {""}:
        first, second = second, first
    number = second.get("", 0.0)
    if set(second) != {""} or not number:
        return None
    by = number if operator == "*" else 1.0 / number
    return {name: factor * by for name, factor in first.items()}


def _span_of_parts(term: Term, kinds: Mapping[str, SignalKind]) -> Span:
    """Return the interval of a term that is no sum, by the intervals of its parts."""
    if isinstance(term, AbsoluteTerm):
        least, most = _span(term.term, kinds)
        nearest = 0.0 if least <= 0.0 <= most else min(abs(least), abs(most))
        return nearest, max(abs(least), abs(most))
    if not isinstance(term, CalculationTerm):
        return -math.inf, math.inf
    first, second = _span(term.left, kinds), _span(term.right, kinds)
    match term.operator:
        case "+":
            ends = [first[0] + second[0], first[1] + second[1]]
        case "-":
            ends = [first[0] - second[1], first[1] - second[0]]
        case "*":
            ends = [a * b for a in first for b in second]
        case "/" if second[0] > 0.0 or second[1] < 0.0:
            ends = [a / b for a in first for b in second]
        case "/":
            ends = [-math.inf, math.inf]
    return min(ends), max(ends)
