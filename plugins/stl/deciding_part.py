"""The deciding part of an STL formula, with its values in its own unit."""

from collections.abc import Mapping
from dataclasses import dataclass

from wil_campaign.plugins.stl.arithmetic import (
    comparison_margin,
    limit_side,
    value_of_term,
    written_atom,
)
from wil_campaign.plugins.stl.formula import StlComparison, Term
from wil_campaign.plugins.stl.robustness import AtomOccurrence
from wil_campaign.plugins.stl.steps import Values
from wil_campaign.plugins.stl.units import SignalKind, unit_text
from wil_campaign.worlds.figures import distinct_value_text


@dataclass(frozen=True, slots=True)
class DecidingPart:
    """The deciding part of a formula: a comparison or a boolean signal at the deciding sample.

    text: the condition that should hold, as formula text. margin: by how much it holds, negative
    where it is violated. actual, limit, margin: None for a boolean signal.
    """

    text: str
    actual: float | None = None
    limit: float | None = None
    unit: str = ""
    margin: float | None = None

    @property
    def violation(self) -> str:
        """Return the deciding part's violation as a sentence."""
        if self.actual is None or self.limit is None:
            return f"{self.text} is violated"
        actual = distinct_value_text(self.actual, self.limit, digits=3)
        values = f"{actual} {self.unit} against {self.limit:g} {self.unit}"
        return f"{self.text} is violated: {' '.join(values.split())}"


def deciding_part_of(
    by: AtomOccurrence, index: int, signals: Mapping[str, Values], kinds: Mapping[str, SignalKind]
) -> DecidingPart:
    """Return the part of a formula that decides at a sample."""
    atom = by.atom
    text = written_atom(atom, positive=by.positive)
    if not isinstance(atom, StlComparison):
        return DecidingPart(text)
    measured, limit = limit_side(atom)
    margin = _at(comparison_margin(atom, signals), index)
    return DecidingPart(
        text=text,
        actual=_at(value_of_term(measured, signals), index),
        limit=_at(value_of_term(limit, signals), index),
        unit=unit_of_either(measured, limit, kinds),
        # Adding 0 turns -0 into 0.
        margin=(margin if by.positive else -margin) + 0.0,
    )


def unit_of_either(one: Term, other: Term, kinds: Mapping[str, SignalKind]) -> str:
    """Return the unit of a deciding comparison; a bare number has the other side's."""
    return unit_text(one, kinds) or unit_text(other, kinds)


def _at(values: Values, index: int) -> float:
    return float(values if values.ndim == 0 else values[index])
