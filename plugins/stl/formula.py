"""The nodes of an STL formula, each with its offset in the text."""

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
class Number:
    """A constant in a formula; it has the unit of the signal that it is compared with."""

    value: float
    at: int


@dataclass(frozen=True, slots=True)
class Name:
    """A signal's name in a formula."""

    name: str
    at: int


@dataclass(frozen=True, slots=True)
class Calculation:
    """Arithmetic on two terms of a formula."""

    operator: Literal["+", "-", "*", "/"]
    left: "Term"
    right: "Term"
    at: int


@dataclass(frozen=True, slots=True)
class Absolute:
    """The absolute value of a term in a formula."""

    term: "Term"
    at: int


Term = Number | Name | Calculation | Absolute


@dataclass(frozen=True, slots=True)
class Comparison:
    """A comparison of two terms in a formula; its robustness is their difference."""

    left: Term
    comparator: Comparator
    right: Term
    at: int


@dataclass(frozen=True, slots=True)
class Holds:
    """A boolean signal in a formula."""

    name: Name
    at: int


@dataclass(frozen=True, slots=True)
class Not:
    """A negated formula."""

    inner: "Formula"
    at: int


@dataclass(frozen=True, slots=True)
class Junctor:
    """Two formulas joined by and, or, implies, iff."""

    word: Junction
    left: "Formula"
    right: "Formula"
    at: int


@dataclass(frozen=True, slots=True)
class Interval:
    """An interval of a formula, seconds; until_s None is to the end of the window."""

    from_s: float = 0.0
    until_s: float | None = None


@dataclass(frozen=True, slots=True)
class Temporal:
    """A temporal formula: always, historically (all times); eventually, once (some time)."""

    word: Modal
    interval: Interval
    inner: "Formula"
    at: int


@dataclass(frozen=True, slots=True)
class Until:
    """The formula left until right: left holds until, within the interval, right does."""

    interval: Interval
    left: "Formula"
    right: "Formula"
    at: int


Atom = Comparison | Holds
Formula = Atom | Not | Junctor | Temporal | Until
Node = Term | Formula


def children(node: Node) -> tuple[Node, ...]:
    """Return the parts that a formula's node is made of."""
    match node:
        case Number() | Name():
            return ()
        case Absolute(term):
            return (term,)
        case Not(inner) | Temporal(_, _, inner):
            return (inner,)
        case Holds(name):
            return (name,)
        case Calculation(_, left, right) | Comparison(left, _, right):
            return (left, right)
        case Junctor(_, left, right) | Until(_, left, right):
            return (left, right)


def names_of(node: Node) -> tuple[Name, ...]:
    """Return every signal name in a formula, in the order of the text."""
    if isinstance(node, Name):
        return (node,)
    return tuple(name for child in children(node) for name in names_of(child))


def first_needed_s(formula: Formula, at_s: float = 0.0) -> Iterator[tuple[Atom, float]]:
    """Yield each atom of a formula with the first time at which the formula needs it, seconds.

    at_s: when the formula itself is needed; times count from the opening of the window.
    """
    match formula:
        case Comparison() | Holds():
            yield formula, at_s
        case Not(inner):
            yield from first_needed_s(inner, at_s)
        case Temporal("always" | "eventually", interval, inner):
            yield from first_needed_s(inner, at_s + interval.from_s)
        case Temporal(_, interval, inner):
            back_s = at_s if interval.until_s is None else interval.until_s
            yield from first_needed_s(inner, max(0.0, at_s - back_s))
        case Junctor(_, left, right):
            yield from first_needed_s(left, at_s)
            yield from first_needed_s(right, at_s)
        case Until(interval, left, right):
            yield from first_needed_s(left, at_s)
            yield from first_needed_s(right, at_s + interval.from_s)


FORMULAS = (Comparison, Holds, Not, Junctor, Temporal, Until)
TERMS = (Number, Name, Calculation, Absolute)
