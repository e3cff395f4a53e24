"""Robustness by rtamt against the definition, written out slowly."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from safety.stl.formula import Comparison, Formula, Junctor, Name, Not, Number, Temporal, Until
from safety.stl.parser import parse_stl
from safety.stl.robustness import StlMonitor

GRID_S = 0.5
"""Samples, bounds and all: values change on this grid only, so that looking there is enough."""
Trace = dict[str, list[float]]


def defined(formula: Formula, trace: Trace, t: int) -> float:  # noqa: PLR0911  # one each
    """Return the robustness at grid point t by the definition; the last value lasts on."""
    match formula:
        case Comparison(Name(name), comparator, Number(limit)):
            values = trace[name]
            margin = values[min(t, len(values) - 1)] - limit
            return margin if comparator in {">", ">="} else -margin
        case Not(inner):
            return -defined(inner, trace, t)
        case Junctor("and", left, right):
            return min(defined(left, trace, t), defined(right, trace, t))
        case Junctor("or", left, right):
            return max(defined(left, trace, t), defined(right, trace, t))
        case Junctor("implies", left, right):
            return max(-defined(left, trace, t), defined(right, trace, t))
        case Junctor("iff", left, right):
            one, other = defined(left, trace, t), defined(right, trace, t)
            return min(max(-one, other), max(-other, one))
        case Temporal(word, interval, inner):
            best: Callable[[list[float]], float] = min if word == "always" else max
            return best([defined(inner, trace, at) for at in points(interval, trace, t)])
        case Until(interval, left, right):
            found = -math.inf
            for at in points(interval, trace, t):
                held = min(defined(left, trace, k) for k in range(t, at + 1))
                found = max(found, min(held, defined(right, trace, at)))
            return found
    raise AssertionError(formula)


def points(interval, trace: Trace, t: int) -> range:
    first = t + round(interval.from_s / GRID_S)
    if interval.until_s is not None:
        return range(first, t + round(interval.until_s / GRID_S) + 1)
    return range(first, max(first, *(len(values) for values in trace.values())) + 1)


bounds = st.sampled_from(["", "[0,0.5]", "[0,2]", "[0.5,1]", "[1,1]", "[2,30]"])
atoms = st.builds(
    "{} {} {}".format,
    st.sampled_from("ab"),
    st.sampled_from([">=", "<=", ">", "<"]),
    st.sampled_from([-1.5, 0, 0.5, 2.5]),
)
formulas = st.recursive(
    atoms,
    lambda inner: st.one_of(
        st.builds("not ({})".format, inner),
        st.builds("({}) {} ({})".format, inner, st.sampled_from(["and", "or", "->", "<->"]), inner),
        st.builds("{}{} ({})".format, st.sampled_from(["always", "eventually"]), bounds, inner),
        st.builds("({}) until{} ({})".format, inner, bounds, inner),
    ),
    max_leaves=4,
)
series = st.lists(st.integers(-3, 3).map(float), min_size=1, max_size=10)


def signals(trace: Trace) -> dict[str, np.ndarray]:
    return {name: np.array(values) for name, values in trace.items()}


def times(count: int) -> list[float]:
    return [100.0 + i * GRID_S for i in range(count)]


@settings(max_examples=200, deadline=None)
@given(formulas, series, st.data())
def test_robustness_is_what_the_definition_says(text: str, a: list[float], data) -> None:
    b = data.draw(st.lists(st.integers(-3, 3).map(float), min_size=len(a), max_size=len(a)))
    formula, trace = parse_stl(text), {"a": a, "b": b}
    found = StlMonitor(formula).robustness(times(len(a)), signals(trace), times(len(a))[-1])
    assert found.value == defined(formula, trace, 0)


@settings(max_examples=100, deadline=None)
@given(formulas, st.lists(st.tuples(*[st.integers(-3, 3).map(float)] * 2), min_size=2, max_size=8))
def test_what_cannot_hold_any_more_does_not_hold_in_the_end(text, rows) -> None:
    """The best that may come is never worse than what came; known to the end, both are one."""
    monitor = StlMonitor(parse_stl(text))
    trace = {"a": [row[0] for row in rows], "b": [row[1] for row in rows]}
    end = monitor.robustness(times(len(rows)), signals(trace), times(len(rows))[-1]).value
    for count in range(1, len(rows)):
        part = {name: values[:count] for name, values in trace.items()}
        assert monitor.at_best(times(count), signals(part), times(count)[-1] + GRID_S) >= end


def robust(text: str, values: list[float], end_s: float | None = None):
    last_s = times(len(values))[-1] if end_s is None else end_s
    return StlMonitor(parse_stl(text)).robustness(
        times(len(values)), {"a": np.array(values)}, last_s
    )


def test_the_comparison_that_decides_is_told_with_its_sample() -> None:
    found = robust("always (a >= 1 and a <= 5)", [3.0, 2.0, 4.5, 3.0])
    assert found.value == 0.5
    occurrence, index = found.decided_by
    assert (occurrence.atom.comparator, index) == ("<=", 2)


def test_a_value_lasts_from_its_last_sample_on() -> None:
    assert robust("eventually[10,20] (a >= 1)", [0.0, 3.0]).value == 2.0
    assert robust("always[0,0.2] (a >= 1)", [3.0, 0.0]).value == 2.0


@pytest.mark.parametrize(
    ("text", "values", "lost"),
    [
        ("always (a >= 1)", [2.0, 0.5], True),
        ("always (a >= 1)", [2.0, 1.5], False),
        ("eventually[0,0.5] (a >= 1)", [0.0, 0.0, 0.0], True),
        ("eventually[0,30] (a >= 1)", [0.0, 0.0, 0.0], False),
        ("not eventually (a >= 1)", [0.0, 2.0], True),
        ("(a <= 1) until[0,30] (a >= 2)", [0.0, 1.5], True),
    ],
)
def test_whether_a_formula_can_hold_still(text: str, values: list[float], lost: bool) -> None:
    best = StlMonitor(parse_stl(text)).at_best(
        times(len(values)), {"a": np.array(values)}, times(len(values))[-1] + 0.1
    )
    assert (best < 0.0) is lost


@pytest.mark.parametrize(
    ("text", "value"), [("a / (a - a) >= 1", 1e12), ("0 / (a - a) >= 1", -1e12)]
)
def test_what_is_divided_by_nothing_stays_a_number(text: str, value: float) -> None:
    assert robust(text, [1.0, 1.0]).value == value
