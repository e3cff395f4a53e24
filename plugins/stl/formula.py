"""The nodes of an STL formula, each with its offset in the text."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

Comparator = Literal[">=", "<=", ">", "<"]
Junction = Literal["and", "or", "implies", "iff"]
Modal = Literal["always", "eventually", "once", "historically"]


class StlError(ValueError):
    """A malformed STL formula, with the offset of the mistake in its text (from 0)."""

    def __init__(self, message: str, offset: int, suggestion: str = "") -> None:
        super().__init__(message)
        self.offset = offset
        self.suggestion = suggestion


@dataclass(frozen=True, slots=True)
class ConstantTerm:
    """A constant in a formula; it has the unit of the signal that it is compared with."""

    value: float
    at: int


@dataclass(frozen=True, slots=True)
class SignalTerm:
    """A signal's name in a formula."""

    name: str
    at: int


@dataclass(frozen=True, slots=True)
class CalculationTerm:
    """Arithmetic on two terms of a formula."""

    operator: Literal["+", "-", "*", "/"]
    left: "Term"
    right: "Term"
    at: int


@dataclass(frozen=True, slots=True)
class AbsoluteTerm:
    """The absolute value of a term in a formula."""

    term: "Term"
    at: int


Term = ConstantTerm | SignalTerm | CalculationTerm | AbsoluteTerm


@dataclass(frozen=True, slots=True)
class StlComparison:
    """A comparison of two terms in a formula; its robustness is their difference."""

    left: Term
    comparator: Comparator
    right: Term
    at: int


@dataclass(frozen=True, slots=True)
class BooleanAtom:
    """A boolean signal in a formula."""

    name: SignalTerm
    at: int


@dataclass(frozen=True, slots=True)
class NegatedFormula:
    """A negated formula."""

    inner: "Formula"
    at: int


@dataclass(frozen=True, slots=True)
class JunctorFormula:
    """Two formulas joined by and, or, implies, iff."""

    word: Junction
    left: "Formula"
    right: "Formula"
    at: int


@dataclass(frozen=True, slots=True)
class StlInterval:
    """An interval of a formula, seconds; until_s None is to the end of the window."""

    from_s: float = 0.0
    until_s: float | None = None


@dataclass(frozen=True, slots=True)
class TemporalFormula:
    """A temporal formula: always, historically (all times); eventually, once (some time)."""

    word: Modal
    interval: StlInterval
    inner: "Formula"
    at: int


@dataclass(frozen=True, slots=True)
class UntilFormula:
    """The formula left until right: left holds until, within the interval, right does."""

    interval: StlInterval
    left: "Formula"
    right: "Formula"
    at: int


Atom = StlComparison | BooleanAtom
Formula = Atom | NegatedFormula | JunctorFormula | TemporalFormula | UntilFormula
Node = Term | Formula


def formula_children(node: Node) -> tuple[Node, ...]:
    """Return the parts that a formula's node is made of."""
    match node:
        case ConstantTerm() | SignalTerm():
            return ()
        case AbsoluteTerm(term):
            return (term,)
        case NegatedFormula(inner) | TemporalFormula(_, _, inner):
            return (inner,)
        case BooleanAtom(name):
            return (name,)
        case CalculationTerm(_, left, right) | StlComparison(left, _, right):
            return (left, right)
        case JunctorFormula(_, left, right) | UntilFormula(_, left, right):
            return (left, right)


def signal_names_of(node: Node) -> tuple[SignalTerm, ...]:
    """Return every signal name in a formula, in the order of the text."""
    if isinstance(node, SignalTerm):
        return (node,)
    return tuple(name for child in formula_children(node) for name in signal_names_of(child))


def first_needed_s(formula: Formula, at_s: float = 0.0) -> Iterator[tuple[Atom, float]]:
    """Yield each atom of a formula with the first time at which the formula needs it, seconds.

    at_s: when the formula itself is needed; times count from the opening of the window.
    """
    match formula:
        case StlComparison() | BooleanAtom():
            yield formula, at_s
        case NegatedFormula(inner):
            yield from first_needed_s(inner, at_s)
        case TemporalFormula("always" | "eventually", interval, inner):
            yield from first_needed_s(inner, at_s + interval.from_s)
        case TemporalFormula(_, interval, inner):
            back_s = at_s if interval.until_s is None else interval.until_s
            yield from first_needed_s(inner, max(0.0, at_s - back_s))
        case JunctorFormula(_, left, right):
            yield from first_needed_s(left, at_s)
            yield from first_needed_s(right, at_s)
        case UntilFormula(interval, left, right):
            yield from first_needed_s(left, at_s)
            yield from first_needed_s(right, at_s + interval.from_s)


def seen_ahead_s(formula: Formula) -> float:
    """Return how long after a time the value of a formula at that time is known, seconds.

    Infinite without a limit.
    """
    match formula:
        case NegatedFormula(inner) | TemporalFormula("once" | "historically", _, inner):
            return seen_ahead_s(inner)
        case TemporalFormula(_, StlInterval(_, float(until_s)), inner):
            return until_s + seen_ahead_s(inner)
        case JunctorFormula(_, left, right):
            return max(seen_ahead_s(left), seen_ahead_s(right))
        case UntilFormula(StlInterval(_, float(until_s)), left, right):
            return until_s + max(seen_ahead_s(left), seen_ahead_s(right))
    return 0.0 if isinstance(formula, Atom) else math.inf


def looks_back_s(node: Node) -> float:
    """Return how far before a time the value of a formula at that time looks, seconds.

    Infinite without a limit.
    """
    own_s = 0.0
    if isinstance(node, TemporalFormula) and node.word in {"once", "historically"}:
        own_s = math.inf if node.interval.until_s is None else node.interval.until_s
    return own_s + max(map(looks_back_s, formula_children(node)), default=0.0)


FORMULAS = (
    StlComparison,
    BooleanAtom,
    NegatedFormula,
    JunctorFormula,
    TemporalFormula,
    UntilFormula,
)
TERMS = (ConstantTerm, SignalTerm, CalculationTerm, AbsoluteTerm)
