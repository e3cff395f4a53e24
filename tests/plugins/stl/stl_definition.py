"""What tests of STL share: robustness by the definition, written out slowly, and formulas."""

import math
from collections.abc import Callable

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from wil_campaign.plugins.stl.formula import (
    FORMULAS,
    ConstantTerm,
    Formula,
    JunctorFormula,
    NegatedFormula,
    SignalTerm,
    StlComparison,
    StlInterval,
    TemporalFormula,
    UntilFormula,
    formula_children,
)

GRID_S = 0.5
"""Samples, bounds and all: values change on this grid only, so that looking there is enough."""
Trace = dict[str, list[float]]


def horizon_s(formula: Formula) -> float:
    """Return how far into the future a formula looks, where its intervals say so."""
    own_s = 0.0
    match formula:
        case TemporalFormula("always" | "eventually", interval) | UntilFormula(interval):
            own_s = interval.until_s or interval.from_s
    inner = [horizon_s(c) for c in formula_children(formula) if isinstance(c, FORMULAS)]
    return own_s + max(inner, default=0.0)


def defined(formula: Formula, trace: Trace, t: int) -> float:  # noqa: PLR0911  # one each
    """Return the robustness at grid point t by the definition; the last value lasts on."""
    match formula:
        case StlComparison(SignalTerm(name), comparator, ConstantTerm(limit)):
            values = trace[name]
            margin = values[min(t, len(values) - 1)] - limit
            return margin if comparator in {">", ">="} else -margin
        case NegatedFormula(inner):
            return -defined(inner, trace, t)
        case JunctorFormula("and", left, right):
            return min(defined(left, trace, t), defined(right, trace, t))
        case JunctorFormula("or", left, right):
            return max(defined(left, trace, t), defined(right, trace, t))
        case JunctorFormula("implies", left, right):
            return max(-defined(left, trace, t), defined(right, trace, t))
        case JunctorFormula("iff", left, right):
            one, other = defined(left, trace, t), defined(right, trace, t)
            return min(max(-one, other), max(-other, one))
        case TemporalFormula(word, interval, inner):
            lowest = word in {"always", "historically"}
            best: Callable[..., float] = min if lowest else max
            past = word in {"once", "historically"}
            at = points_before(interval, t) if past else points(interval, trace, t)
            return best((defined(inner, trace, k) for k in at), default=math.inf * (2 * lowest - 1))
        case UntilFormula(interval, left, right):
            found = -math.inf
            for end in points(interval, trace, t):
                held = min(defined(left, trace, k) for k in range(t, end + 1))
                found = max(found, min(held, defined(right, trace, end)))
            return found
    raise AssertionError(formula)


def points(interval: StlInterval, trace: Trace, t: int) -> range:
    first = t + round(interval.from_s / GRID_S)
    if interval.until_s is not None:
        return range(first, t + round(interval.until_s / GRID_S) + 1)
    return range(first, max(first, *(len(values) - 1 for values in trace.values())) + 1)


def points_before(interval: StlInterval, t: int) -> range:
    last = t - round(interval.from_s / GRID_S)
    first = 0 if interval.until_s is None else t - round(interval.until_s / GRID_S)
    return range(max(0, first), last + 1)


BOUNDS = st.sampled_from(["", "[0,0.5]", "[0,2]", "[0.5,1]", "[1,1]", "[2,30]"])
ATOMS = st.builds(
    "{} {} {}".format,
    st.sampled_from("ab"),
    st.sampled_from([">=", "<=", ">", "<"]),
    st.sampled_from([-1.5, 0, 0.5, 2.5]),
)


def formulas(*modals: str, bounds: st.SearchStrategy[str] = BOUNDS) -> st.SearchStrategy[str]:
    """Return formulas with these temporal operators, and `until`."""
    return st.recursive(
        ATOMS,
        lambda inner: st.one_of(
            st.builds("not ({})".format, inner),
            st.builds(
                "({}) {} ({})".format, inner, st.sampled_from(["and", "or", "->", "<->"]), inner
            ),
            st.builds("{}{} ({})".format, st.sampled_from(modals), bounds, inner),
            st.builds("({}) until{} ({})".format, inner, bounds, inner),
        ),
        max_leaves=4,
    )


def signals(trace: Trace) -> dict[str, NDArray[np.float64]]:
    return {name: np.array(values) for name, values in trace.items()}


def times(count: int) -> list[float]:
    return [100.0 + i * GRID_S for i in range(count)]
