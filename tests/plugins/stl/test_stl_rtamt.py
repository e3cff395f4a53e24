"""Robustness against rtamt, an implementation by others; only where it can be installed."""

import sys
import typing
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.plugins.stl.stl_definition import formulas, horizon_s
from wil_campaign.plugins.stl.arithmetic import written_atom
from wil_campaign.plugins.stl.formula import (
    BooleanAtom,
    Formula,
    JunctorFormula,
    NegatedFormula,
    StlComparison,
    StlInterval,
    TemporalFormula,
    UntilFormula,
)
from wil_campaign.plugins.stl.monitor import FormulaRobustness, StlMonitor
from wil_campaign.plugins.stl.parser import parse_stl

# antlr4 4.7, which rtamt needs, imports typing.io: it warns in Python 3.12 and is gone in 3.13.
sys.modules.setdefault("typing.io", typing)
rtamt = pytest.importorskip("rtamt", reason="rtamt has no wheel for Python 3.13 and later")

bounds = st.sampled_from(["", "[0,0.25]", "[0,2]", "[0.625,1]", "[1,1]", "[2,30]"])
bounded = st.sampled_from(["[0,0.25]", "[0,2]", "[0.625,1]", "[0,0.875]"])
# Sums and differences of these are exact in binary: rtamt reckons in floats, and misses a sample at
# 0.4 s that the window [0.1 s, 0.1 s + 0.3 s] ends with.
steps_s = st.sampled_from([0.125, 0.25, 0.375, 0.5, 0.75, 1.25])
series = st.lists(
    st.tuples(steps_s, st.integers(-9, 9), st.integers(-9, 9)), min_size=1, max_size=8
)
Series = list[tuple[float, int, int]]


def rtamt_text(formula: Formula) -> str:
    """Return a formula as rtamt reads it, with all parentheses."""
    match formula:
        case StlComparison() | BooleanAtom():
            return f"({written_atom(formula)})"
        case NegatedFormula(inner):
            return f"(not {rtamt_text(inner)})"
        case JunctorFormula("iff", left, right):
            # rtamt's own iff is another one, minus the distance of the two robustnesses.
            one, other = rtamt_text(left), rtamt_text(right)
            return f"(({one} implies {other}) and ({other} implies {one}))"
        case JunctorFormula(word, left, right):
            return f"({rtamt_text(left)} {word} {rtamt_text(right)})"
        case TemporalFormula(word, interval, inner):
            return f"({word}{span(interval)} {rtamt_text(inner)})"
        case UntilFormula(interval, left, right):
            return f"({rtamt_text(left)} until{span(interval)} {rtamt_text(right)})"


def span(interval: StlInterval) -> str:
    if interval.until_s is None:
        return ""
    return f"[{interval.from_s:.9f},{interval.until_s:.9f}]"


def reference(formula: Formula, at_s: list[float], trace: dict[str, list[float]]) -> float:
    """Return rtamt's robustness; the last value lasts on as far as the formula looks."""
    specification: Any = rtamt.StlDenseTimeSpecification()
    for name in trace:
        specification.declare_var(name, "float")
    specification.spec = rtamt_text(formula)
    specification.parse()
    last_s = at_s[-1] + horizon_s(formula) + 1.0
    inputs = [
        [name, [*([t, v] for t, v in zip(at_s, values, strict=True)), [last_s, values[-1]]]]
        for name, values in trace.items()
    ]
    value: float = specification.evaluate(*inputs)[0][1]
    return value


def compared(text: str, rows: Series) -> None:
    formula = parse_stl(text)
    at_s = np.cumsum([0.0, *(row[0] for row in rows[1:])]).tolist()
    trace = {"a": [float(row[1]) for row in rows], "b": [float(row[2]) for row in rows]}
    values = {name: np.array(each) for name, each in trace.items()}
    found = StlMonitor(formula).robustness(at_s, values, at_s[-1])
    assert isinstance(found, FormulaRobustness)
    assert found.value == pytest.approx(reference(formula, at_s, trace))


@settings(max_examples=300, deadline=None)
@given(formulas("always", "eventually", bounds=bounds), series)
def test_robustness_is_that_of_rtamt(text: str, rows: Series) -> None:
    compared(text, rows)


@settings(max_examples=100, deadline=None)
@given(
    st.sampled_from(["once", "historically"]),
    bounded,
    formulas("always", "eventually", bounds=bounded),
    series,
)
def test_the_past_is_that_of_rtamt(modal: str, interval: str, inner: str, rows: Series) -> None:
    compared(f"always[2,4] ({modal}{interval} ({inner}))", rows)
