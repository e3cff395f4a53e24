"""Robustness against the definition, written out slowly, and what decides it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.plugins.stl.stl_definition import GRID_S, defined, formulas, signals, times
from wil_campaign.plugins.stl.arithmetic import written_atom
from wil_campaign.plugins.stl.monitor import FormulaRobustness, StlMonitor
from wil_campaign.plugins.stl.parser import parse_stl
from wil_campaign.plugins.stl.robustness import UnevaluableFormula

FUTURE = ("always", "eventually")
ALL = (*FUTURE, "once", "historically")
level = st.integers(-3, 3).map(float)
rows = st.lists(st.tuples(level, level), min_size=1, max_size=10)


def evaluated(
    text: str, trace: dict[str, list[float]], end_s: float | None = None
) -> FormulaRobustness:
    at_s = times(len(trace["a"]))
    last_s = at_s[-1] if end_s is None else end_s
    found = StlMonitor(parse_stl(text)).robustness(at_s, signals(trace), last_s)
    assert isinstance(found, FormulaRobustness), found
    return found


def robust(text: str, values: list[float], end_s: float | None = None) -> FormulaRobustness:
    return evaluated(text, {"a": values}, end_s)


def best(text: str, trace: dict[str, list[float]], end_s: float) -> float:
    at_s = times(len(trace["a"]))
    found = StlMonitor(parse_stl(text)).at_best(at_s, signals(trace), end_s)
    assert isinstance(found, FormulaRobustness), found
    return found.value


def columns(table: list[tuple[float, float]]) -> dict[str, list[float]]:
    return {"a": [row[0] for row in table], "b": [row[1] for row in table]}


@settings(max_examples=400, deadline=None)
@given(formulas(*ALL), rows)
def test_robustness_is_what_the_definition_says(
    text: str, table: list[tuple[float, float]]
) -> None:
    formula, trace = parse_stl(text), columns(table)
    at_s = times(len(table))
    found = StlMonitor(formula).robustness(at_s, signals(trace), at_s[-1])
    value = defined(formula, trace, 0)
    if math.isinf(value):
        assert isinstance(found, UnevaluableFormula)
        assert "looks back" in str(found)
    else:
        assert isinstance(found, FormulaRobustness)
        assert found.value == value


@settings(max_examples=200, deadline=None)
@given(formulas(*ALL), rows)
def test_a_formula_holds_or_its_negation_does(text: str, table: list[tuple[float, float]]) -> None:
    """Also at a robustness of 0, where < and <= decide."""
    trace, at_s = signals(columns(table)), times(len(table))
    found = StlMonitor(parse_stl(text)).robustness(at_s, trace, at_s[-1])
    negated = StlMonitor(parse_stl(f"not ({text})")).robustness(at_s, trace, at_s[-1])
    if isinstance(found, FormulaRobustness):
        assert isinstance(negated, FormulaRobustness)
        assert (negated.value, negated.holds) == (-found.value, not found.holds)
        assert found.value == 0.0 or found.holds is (found.value > 0.0)


@settings(max_examples=300, deadline=None)
@given(formulas(*ALL), rows, st.floats(0.0, 4.0))
def test_the_best_that_may_come_is_never_below_the_final_value(
    text: str, table: list[tuple[float, float]], more_s: float
) -> None:
    """The best that may come is never worse than what came; known to the end, both are one."""
    at_s = times(len(table))
    monitor = StlMonitor(parse_stl(text))
    end = monitor.robustness(at_s, signals(columns(table)), at_s[-1] + more_s)
    if isinstance(end, UnevaluableFormula):
        return
    for count in range(1, len(table)):
        part = columns(table[:count])
        assert best(text, part, times(count)[-1] + GRID_S / 2) >= end.value
    assert best(text, columns(table), at_s[-1] + more_s) >= end.value


@settings(max_examples=100, deadline=None)
@given(rows, st.sampled_from(["[0,0.5]", "[0.5,1]", "[0,30]", ""]))
def test_the_comparison_that_decides_has_the_value(
    table: list[tuple[float, float]], bounds: str
) -> None:
    trace = columns(table)
    found = evaluated(f"always{bounds} (a >= 1 and not (b > 0.5))", trace)
    assert found.decided_by is not None
    name = "a" if found.decided_by.positive else "b"
    value = trace[name][found.index]
    assert found.value == (value - 1 if name == "a" else 0.5 - value)


def test_the_comparison_that_decides_is_named_with_its_sample() -> None:
    found = robust("always (a >= 1 and a <= 5)", [3.0, 2.0, 4.5, 3.0])
    assert found.value == 0.5
    assert found.decided_by is not None
    assert (written_atom(found.decided_by.atom), found.index) == ("a <= 5", 2)


def test_the_conclusion_of_a_violated_implication_decides() -> None:
    """The premise is nearer to the limit; but what is violated is the conclusion."""
    found = evaluated("always (a < 1 implies b <= 2)", {"a": [5.0, 0.9, 5.0], "b": [1.0, 4.0, 9.0]})
    assert not found.holds
    assert found.value == pytest.approx(-0.1)
    assert found.decided_by is not None
    assert (written_atom(found.decided_by.atom), found.index) == ("b <= 2", 1)


@pytest.mark.parametrize(
    ("text", "decides"),
    [
        ("not always (a < 1 implies b <= 2)", "a < 1"),
        ("(a < 1 implies b <= 2) iff (a < 0.5)", "a < 1"),
        ("(a < 1 implies b <= 2) iff (a > 0)", "b <= 2"),
    ],
)
def test_what_an_implication_leaves_when_it_is_to_be_violated_is_its_own(
    text: str, decides: str
) -> None:
    """Its violation lets the whole hold: by no more than the comparison nearest to its limit."""
    found = evaluated(text, {"a": [0.9], "b": [4.0]})
    assert found.value == pytest.approx(0.1 if decides == "a < 1" else -0.1)
    assert found.decided_by is not None
    assert written_atom(found.decided_by.atom) == decides


def test_units_that_meet_count_as_shares_of_their_limits() -> None:
    trace = {"a": np.array([2.0, 0.3]), "b": np.array([5.0, 1.0])}
    text = "always (a >= 0.2 and b <= 8)"
    plain = StlMonitor(parse_stl(text)).robustness([0.0, 1.0], trace, 1.0)
    mixed = StlMonitor(parse_stl(text), mixed=True).robustness([0.0, 1.0], trace, 1.0)
    assert isinstance(plain, FormulaRobustness)
    assert isinstance(mixed, FormulaRobustness)
    assert plain.decided_by is not None
    assert mixed.decided_by is not None
    # 0.1 of a against 3 of b; half of a's limit against three eighths of b's.
    assert written_atom(plain.decided_by.atom) == "a >= 0.2"
    assert (written_atom(mixed.decided_by.atom), mixed.value) == ("b <= 8", 0.375)


def test_a_comparison_of_true_and_false_has_no_distance() -> None:
    trace = {"a": [1.0, 1.0, 0.0], "b": [1.5, 1.75, 9.0]}
    assert evaluated("always (a implies b <= 2)", trace).value == 0.25
    found = evaluated("eventually not a", trace)
    assert (found.value, found.holds) == (math.inf, True)
    assert evaluated("always a", trace).value == -math.inf


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("a <= 1 and a > 1", False),
        ("a > 1 and a <= 1", False),
        ("a <= 1 or a > 1", True),
        ("a > 1 or a <= 1", True),
        ("always (a >= 1)", True),
        ("not eventually (a < 1)", True),
        ("not eventually (a <= 1)", False),
        ("(a <= 1) until[0,1] (a > 1)", False),
        ("a < 1 implies a > 1", True),
    ],
)
def test_strict_and_loose_comparisons_differ_exactly_at_the_limit(text: str, holds: bool) -> None:
    found = robust(text, [1.0, 1.0, 1.0])
    assert (found.value, found.holds) == (0.0, holds)


def test_a_value_lasts_from_its_last_sample_on() -> None:
    assert robust("eventually[10,20] (a >= 1)", [0.0, 3.0]).value == 2.0
    assert robust("always[0,0.2] (a >= 1)", [3.0, 0.0]).value == 2.0


def test_bounds_meet_samples_to_the_nanosecond() -> None:
    """0.3 - 0.1 is not 0.2 in binary: no sliver of time may be left between the two."""
    at_s = [0.0, 0.1, 0.2, 0.3, 0.4]
    values = {"a": np.array([1.0, 1.0, 1.0, -5.0, 1.0])}
    for text, value in [
        ("always[0,0.1] eventually[0.1,0.1] (a >= 0)", 1.0),
        ("always[0.1,0.1] always[0,0.1] (a >= 0)", 1.0),
        ("always[0.1,0.1] always[0.1,0.2] (a >= 0)", -5.0),
        ("eventually[0.3,0.3] historically[0.1,0.3] (a >= 0)", 1.0),
    ]:
        found = StlMonitor(parse_stl(text)).robustness(at_s, values, 0.4)
        assert isinstance(found, FormulaRobustness)
        assert found.value == value, text


@pytest.mark.parametrize(
    ("text", "values", "lost"),
    [
        ("always (a >= 1)", [2.0, 0.5], True),
        ("always (a >= 1)", [2.0, 1.5], False),
        ("eventually[0,0.5] (a >= 1)", [0.0, 0.0, 0.0], True),
        ("eventually[0,30] (a >= 1)", [0.0, 0.0, 0.0], False),
        ("not eventually (a >= 1)", [0.0, 2.0], True),
        ("(a <= 1) until[0,30] (a >= 2)", [0.0, 1.5], True),
        # The window may end before the past is looked at, and may go on until it is over.
        ("always historically[0,5] (a >= 1)", [2.0, 0.5], True),
        ("always once[0,5] (a >= 1)", [0.5, 2.0], True),
        ("always once[0,5] (a >= 1)", [2.0, 0.5], False),
        ("eventually historically[0,5] (a >= 1)", [0.5, 0.5], False),
    ],
)
def test_a_formula_is_lost_once_it_cannot_hold_any_more(
    text: str, values: list[float], lost: bool
) -> None:
    assert (best(text, {"a": values}, times(len(values))[-1] + 0.1) < 0.0) is lost


@pytest.mark.parametrize("text", ["a / (a - a) >= 1", "0 / (a - a) >= 1", "1e300 * a * 1e300 > 1"])
@pytest.mark.parametrize("whole", ["{}", "not ({})", "always ({})", "a > 0 or {}"])
def test_a_value_that_is_not_finite_cannot_be_judged(text: str, whole: str) -> None:
    """It passed with a margin of 1e12, and so did its negation's equal."""
    monitor = StlMonitor(parse_stl(whole.format(text)))
    for find in (monitor.robustness, monitor.at_best):
        found = find([3.0, 4.0], {"a": np.array([1.0, 1.0])}, 5.0)
        assert isinstance(found, UnevaluableFormula)
        assert found.at_s == 3.0
        assert found.problem == "is not finite"


def test_a_missing_value_counts_where_the_formula_needs_it_only() -> None:
    at_s, values = [10.0, 11.0, 12.0], {"a": np.array([math.nan, 1.0, 2.0])}
    found = StlMonitor(parse_stl("always (a >= 0)")).robustness(at_s, values, 12.0)
    assert found == UnevaluableFormula("a", 10.0, "has no value")
    assert str(found) == "a has no value at 10.000 s"
    later = StlMonitor(parse_stl("always[1,5] (a >= 0)")).robustness(at_s, values, 12.0)
    assert isinstance(later, FormulaRobustness)
    assert later.value == 1.0


def test_a_long_recording_takes_one_pass() -> None:
    """A minute at 100 Hz with windows in windows: comparisons grow with the samples alone."""
    count = 6000
    rising = {"a": np.arange(count, dtype=float), "b": -np.arange(count, dtype=float)}
    at_s = [i * 0.01 for i in range(count)]
    for text in ("always eventually[0,20] (a > 0)", "always eventually[0,20] (b > -1e9)"):
        found = StlMonitor(parse_stl(text)).robustness(at_s, rising, at_s[-1])
        assert isinstance(found, FormulaRobustness)
        assert found.holds
