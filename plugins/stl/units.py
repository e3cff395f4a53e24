"""Checks that the signals of an STL formula exist and that its units fit together."""

import math
import operator as arithmetic
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from wil_campaign.foundation.files.problems import closest_word
from wil_campaign.plugins.stl.formula import (
    AbsoluteTerm,
    BooleanAtom,
    CalculationTerm,
    ConstantTerm,
    Formula,
    SignalTerm,
    StlComparison,
    StlError,
    Term,
    formula_children,
)
from wil_campaign.plugins.stl.parser import NO_STATEMENT

Dimension = Mapping[str, int]
"""Base units with their powers: m/s is {m: 1, s: -1}. None is a bare number."""


_ARITHMETIC: Mapping[str, Callable[[float, float], float]] = {
    "+": arithmetic.add,
    "-": arithmetic.sub,
    "*": arithmetic.mul,
    "/": arithmetic.truediv,
}


@dataclass(frozen=True, slots=True)
class SignalKind:
    """The kind of an STL signal. unit: "m/s"; "" for a boolean one. least, most: of its values."""

    unit: str
    meaning: str
    least: float = -math.inf
    most: float = math.inf


def require_sound(formula: Formula, signals: Mapping[str, SignalKind]) -> None:
    """Raise StlError for an unknown signal, units that do not fit, or a side that is not finite."""
    if isinstance(formula, StlComparison):
        left, right = _dimension(formula.left, signals), _dimension(formula.right, signals)
        if None not in {_constant(formula.left), _constant(formula.right)}:
            raise StlError("compares two numbers: name a signal", formula.at)
        _require_same(left, right, formula.at, "compared with")
        return
    if isinstance(formula, BooleanAtom):
        if _kind(formula.name, signals).unit:
            raise StlError(NO_STATEMENT, formula.at)
        return
    for child in formula_children(formula):
        if isinstance(child, Formula):
            require_sound(child, signals)


def unit_text(term: Term, signals: Mapping[str, SignalKind]) -> str:
    """Return the unit of a term as text; "" for a bare number."""
    return _text(_dimension(term, signals) or {})


def has_several_units(formula: Formula, signals: Mapping[str, SignalKind]) -> bool:
    """Return whether a formula joins comparisons of different units."""
    return len(set(_units(formula, signals))) > 1


def _units(formula: Formula, signals: Mapping[str, SignalKind]) -> Iterator[str]:
    if isinstance(formula, StlComparison):
        yield unit_text(formula.left, signals) or unit_text(formula.right, signals)
        return
    for child in formula_children(formula):
        if isinstance(child, Formula):
            yield from _units(child, signals)


def _dimension(term: Term, signals: Mapping[str, SignalKind]) -> Dimension | None:
    """Return the dimension of a term by its units; None for a bare number."""
    match term:
        case ConstantTerm():
            return None
        case SignalTerm():
            unit = _kind(term, signals).unit
            if not unit:
                message = (
                    f"'{term.name}' is true or false: write it by itself, without a comparison"
                )
                raise StlError(message, term.at)
            return _parse_unit(unit)
        case AbsoluteTerm(inner):
            return _dimension(inner, signals)
        case CalculationTerm(operator, left_term, right_term, at):
            left, right = _dimension(left_term, signals), _dimension(right_term, signals)
            if operator in {"+", "-"}:
                _require_same(left, right, at, "added to" if operator == "+" else "subtracted from")
                return right if left is None else left
            if left is None and right is None:
                return None
            return _product(left or {}, right or {}, 1 if operator == "*" else -1)


def _constant(term: Term) -> float | None:
    """Return the value of a term that does not depend on its signals; None for others.

    Raises StlError where it has no finite value.
    """
    match term:
        case ConstantTerm(value):
            return value
        case SignalTerm():
            return None
        case AbsoluteTerm(inner):
            value_inside = _constant(inner)
            return None if value_inside is None else abs(value_inside)
        case CalculationTerm(operator, left_term, right_term, at):
            left, right = _constant(left_term), _constant(right_term)
            if operator == "/" and right == 0.0:
                raise StlError("divides by 0, so it has no value", at)
            if operator in {"*", "/"} and (left == 0.0 or (operator == "*" and right == 0.0)):
                return 0.0
            if left is None or right is None:
                return None
            found = _ARITHMETIC[operator](left, right)
            if not math.isfinite(found):
                raise StlError("is not finite", at)
            return found


def _kind(name: SignalTerm, signals: Mapping[str, SignalKind]) -> SignalKind:
    """Return a signal's kind with its unit. Raises StlError for an unknown signal."""
    kind = signals.get(name.name)
    if kind is None:
        meant = closest_word(name.name, signals)
        known = "" if meant else f" (there are: {', '.join(sorted(signals))})"
        raise StlError(f"unknown signal '{name.name}'{known}", name.at, meant)
    return kind


def _require_same(left: Dimension | None, right: Dimension | None, at: int, how: str) -> None:
    """Raise StlError when the units of two sides differ."""
    if left is not None and right is not None and left != right:
        raise StlError(f"{_text(left)} cannot be {how} {_text(right)}", at)


def _parse_unit(unit: str) -> Dimension:
    over, _, under = unit.partition("/")
    return _product({over: 1}, {under: 1} if under else {}, -1)


def _product(left: Dimension, right: Dimension, sign: int) -> Dimension:
    """Return the dimension of a product or quotient of units."""
    powers = {base: left.get(base, 0) + sign * right.get(base, 0) for base in {*left, *right}}
    return {base: power for base, power in powers.items() if power}


def _text(dimension: Dimension) -> str:
    """Return a dimension as a unit in text ("m/s^2")."""

    def written(base: str, power: int) -> str:
        return base if power == 1 else f"{base}^{power}"

    over = [written(base, power) for base, power in sorted(dimension.items()) if power > 0]
    under = [written(base, -power) for base, power in sorted(dimension.items()) if power < 0]
    return "/".join([" ".join(over) or "1", *under]) if over or under else ""
