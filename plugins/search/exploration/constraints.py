"""Constraints between the parameters of a search, in the language of STL formulas without time."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from wil_campaign.plugins.search.search_part import ParameterValue
from wil_campaign.plugins.stl.arithmetic import comparison_margin
from wil_campaign.plugins.stl.formula import (
    BooleanAtom,
    Formula,
    JunctorFormula,
    NegatedFormula,
    StlComparison,
    StlError,
    TemporalFormula,
    UntilFormula,
    signal_names_of,
)
from wil_campaign.plugins.stl.parser import parse_stl
from wil_campaign.plugins.stl.units import SignalKind, require_sound

_TIMELESS = "parameters have no time: only comparisons, and, or, not, implies, iff"


@dataclass(frozen=True, slots=True)
class SpaceConstraint:
    """A constraint of a search: its text, and its formula."""

    text: str
    formula: Formula

    def holds(self, values: Mapping[str, ParameterValue | None]) -> bool:
        """Return whether values keep the constraint; False where a named value is unknown."""
        if any(values.get(name.name) is None for name in signal_names_of(self.formula)):
            return False
        return _holds(self.formula, values)


def parse_constraint(text: str, kinds: Mapping[str, SignalKind]) -> SpaceConstraint:
    """Return a constraint over these parameters. Raises StlError with the offset of the mistake."""
    formula = parse_stl(text)
    _require_timeless(formula)
    require_sound(formula, kinds)
    return SpaceConstraint(text, formula)


def _require_timeless(formula: Formula) -> None:
    """Raise StlError for an operator of time."""
    match formula:
        case TemporalFormula() | UntilFormula():
            raise StlError(_TIMELESS, formula.at)
        case NegatedFormula(inner):
            _require_timeless(inner)
        case JunctorFormula(_, left, right):
            _require_timeless(left)
            _require_timeless(right)


def _holds(formula: Formula, values: Mapping[str, ParameterValue | None]) -> bool:
    match formula:
        case StlComparison():
            return _compare(formula, values)
        case BooleanAtom(name):
            return bool(values[name.name])
        case NegatedFormula(inner):
            return not _holds(inner, values)
        case JunctorFormula(word, left, right):
            first, second = _holds(left, values), _holds(right, values)
            return {
                "and": first and second,
                "or": first or second,
                "implies": second or not first,
                "iff": first == second,
            }[word]
        case _:
            raise ValueError(_TIMELESS)


def _compare(atom: StlComparison, values: Mapping[str, ParameterValue | None]) -> bool:
    """Return whether a comparison holds; False for a NaN, such as that of 0/0."""
    numbers = {
        name.name: np.array(float(value))
        for name in signal_names_of(atom)
        if isinstance(value := values[name.name], int | float)
    }
    difference = float(comparison_margin(atom, numbers))
    return difference > 0.0 if atom.comparator in {">", "<"} else difference >= 0.0
