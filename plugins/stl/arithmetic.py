"""Terms and comparisons of an STL formula: their values over samples, and how they are written."""

from collections.abc import Callable, Mapping

import numpy as np

from wil_campaign.plugins.stl.formula import (
    Absolute,
    Atom,
    Calculation,
    Comparator,
    Comparison,
    Holds,
    Name,
    Number,
    Term,
)
from wil_campaign.plugins.stl.steps import Values

_ARITHMETIC: dict[str, Callable[[Values, Values], Values]] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
}
_OPPOSITE: dict[Comparator, Comparator] = {">=": "<", "<": ">=", "<=": ">", ">": "<="}


def value_of(term: Term, signals: Mapping[str, Values]) -> Values:
    """Return the arithmetic value of an STL term; division by 0 is infinite, or NaN."""
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


def difference_of(atom: Comparison, signals: Mapping[str, Values]) -> Values:
    """Return the margin by which an STL comparison holds, in its unit; negative if violated."""
    left, right = value_of(atom.left, signals), value_of(atom.right, signals)
    with np.errstate(invalid="ignore", over="ignore"):
        return left - right if atom.comparator in {">=", ">"} else right - left


def limit_side(atom: Comparison) -> tuple[Term, Term]:
    """Return the measured and the limiting side of a comparison: the number, or the right."""
    if isinstance(atom.left, Number):
        return atom.right, atom.left
    return atom.left, atom.right


def scale_of(atom: Atom) -> float:
    """Return the scale by which a comparison's margin is divided where units are mixed."""
    if isinstance(atom, Comparison):
        limit = limit_side(atom)[1]
        if isinstance(limit, Number) and limit.value:
            return abs(limit.value)
    return 1.0


def written(atom: Atom, *, positive: bool = True) -> str:
    """Return an atom, or its negation, as STL text."""
    if isinstance(atom, Holds):
        return atom.name.name if positive else f"not {atom.name.name}"
    comparator = atom.comparator if positive else _OPPOSITE[atom.comparator]
    return f"{written_term(atom.left)} {comparator} {written_term(atom.right)}"


def written_term(term: Term) -> str:
    """Return an arithmetic term as STL text."""
    match term:
        case Number(value):
            return f"{value:g}"
        case Name(name):
            return name
        case Absolute(inner):
            return f"abs({written_term(inner)})"
        case Calculation(operator, left, right):
            first, second = written_term(left), written_term(right)
            if operator in {"*", "/"} and _is_sum(left):
                first = f"({first})"
            if isinstance(right, Calculation) and (operator != "+" or not _is_sum(right)):
                second = f"({second})"
            return f"{first} {operator} {second}"


def _is_sum(term: Term) -> bool:
    return isinstance(term, Calculation) and term.operator in {"+", "-"}
