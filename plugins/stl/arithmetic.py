"""Terms and comparisons of an STL formula: their values over samples, and how they are written."""

from collections.abc import Callable, Mapping

import numpy as np

from wil_campaign.plugins.stl.formula import (
    AbsoluteTerm,
    Atom,
    BooleanAtom,
    CalculationTerm,
    Comparator,
    ConstantTerm,
    SignalTerm,
    StlComparison,
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


def value_of_term(term: Term, signals: Mapping[str, Values]) -> Values:
    """Return the arithmetic value of an STL term; division by 0 is infinite, or NaN."""
    match term:
        case ConstantTerm(value):
            return np.array(value)
        case SignalTerm(name):
            return signals[name]
        case AbsoluteTerm(inner):
            return np.abs(value_of_term(inner, signals))
        case CalculationTerm(operator, left, right):
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                both = value_of_term(left, signals), value_of_term(right, signals)
                return np.asarray(_ARITHMETIC[operator](*both))


def comparison_margin(atom: StlComparison, signals: Mapping[str, Values]) -> Values:
    """Return the margin by which an STL comparison holds, in its unit; negative if violated."""
    left, right = value_of_term(atom.left, signals), value_of_term(atom.right, signals)
    with np.errstate(invalid="ignore", over="ignore"):
        return left - right if atom.comparator in {">=", ">"} else right - left


def limit_side(atom: StlComparison) -> tuple[Term, Term]:
    """Return the measured and the limiting side of a comparison: the number, or the right."""
    if isinstance(atom.left, ConstantTerm):
        return atom.right, atom.left
    return atom.left, atom.right


def margin_scale_of(atom: Atom) -> float:
    """Return the scale by which a comparison's margin is divided where units are mixed."""
    if isinstance(atom, StlComparison):
        limit = limit_side(atom)[1]
        if isinstance(limit, ConstantTerm) and limit.value:
            return abs(limit.value)
    return 1.0


def written_atom(atom: Atom, *, positive: bool = True) -> str:
    """Return an atom, or its negation, as STL text."""
    if isinstance(atom, BooleanAtom):
        return atom.name.name if positive else f"not {atom.name.name}"
    comparator = atom.comparator if positive else _OPPOSITE[atom.comparator]
    return f"{written_term(atom.left)} {comparator} {written_term(atom.right)}"


def written_term(term: Term) -> str:
    """Return an arithmetic term as STL text."""
    match term:
        case ConstantTerm(value):
            return f"{value:g}"
        case SignalTerm(name):
            return name
        case AbsoluteTerm(inner):
            return f"abs({written_term(inner)})"
        case CalculationTerm(operator, left, right):
            first, second = written_term(left), written_term(right)
            if operator in {"*", "/"} and _is_sum(left):
                first = f"({first})"
            if isinstance(right, CalculationTerm) and (operator != "+" or not _is_sum(right)):
                second = f"({second})"
            return f"{first} {operator} {second}"


def _is_sum(term: Term) -> bool:
    return isinstance(term, CalculationTerm) and term.operator in {"+", "-"}
