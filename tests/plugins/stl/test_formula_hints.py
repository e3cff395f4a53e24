"""Comparisons of a formula that no flight decides: each is named, and no other one."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.plugins.stl.arithmetic import comparison_margin, written_atom
from wil_campaign.plugins.stl.formula import (
    AbsoluteTerm,
    CalculationTerm,
    ConstantTerm,
    SignalTerm,
    StlComparison,
    Term,
)
from wil_campaign.plugins.stl.formula_hints import decided_comparisons
from wil_campaign.plugins.stl.parser import parse_stl
from wil_campaign.plugins.stl.stl_signals import signal_docs

KINDS = signal_docs()


@pytest.mark.parametrize(
    ("formula", "found"),
    [
        ("up_m <= up_m", {"up_m <= up_m": True}),
        ("up_m < up_m", {"up_m < up_m": False}),
        ("2 * (up_m + 1) >= up_m + up_m", {"2 * (up_m + 1) >= up_m + up_m": True}),
        ("always (up_m <= 1e308)", {"up_m <= 1e+308": True}),
        ("eventually (up_m >= -1000)", {}),
        ("eventually (up_m >= -200000)", {"up_m >= -200000": True}),
        ("always (clearance_m >= 0)", {"clearance_m >= 0": True}),
        ("always (clearance_m > 0)", {}),
        ("always (distance_gate_m >= 0)", {"distance_gate_m >= 0": True}),
        ("always (battery_percent <= 100 and up_m <= 2)", {"battery_percent <= 100": True}),
        ("always (0 <= tilt_deg <= 30)", {}),
        ("always (abs(yaw_deg) <= 180)", {"abs(yaw_deg) <= 180": True}),
        ("always (abs(yaw_deg) <= 179)", {}),
        ("always (speed_m_s * speed_m_s >= 0)", {"speed_m_s * speed_m_s >= 0": True}),
        ("always (climb_m_s / speed_m_s <= 1)", {}),
        ("always (1 / (speed_m_s + 1) <= 1)", {"1 / (speed_m_s + 1) <= 1": True}),
        ("not (pitch_deg > 90) or armed", {"pitch_deg > 90": False}),
        ("always (armed implies up_m >= 0.1)", {}),
        ("always (speed_m_s * 1e200 * 1e200 <= 1)", {}),
    ],
)
def test_comparisons_that_no_flight_decides(formula: str, found: dict[str, bool]) -> None:
    decided = decided_comparisons(parse_stl(formula), KINDS)
    assert {written_atom(atom): holds for atom, holds in decided} == found


NAMES = ("up_m", "tilt_deg", "clearance_m", "pitch_deg", "battery_percent")
terms: st.SearchStrategy[Term] = st.recursive(
    st.builds(ConstantTerm, st.floats(-300.0, 300.0).map(lambda x: round(x, 1)), st.just(0))
    | st.builds(SignalTerm, st.sampled_from(NAMES), st.just(0)),
    lambda inner: (
        st.builds(AbsoluteTerm, inner, st.just(0))
        | st.builds(CalculationTerm, st.sampled_from("+-*/"), inner, inner, st.just(0))
    ),
    max_leaves=6,
)


@given(
    st.builds(StlComparison, terms, st.sampled_from([">=", "<=", ">", "<"]), terms, st.just(0)),
    st.lists(st.tuples(*(st.floats(0.0, 1.0) for _ in NAMES)), min_size=5, max_size=30),
)
def test_no_value_contradicts_a_decided_comparison(
    atom: StlComparison, shares: list[tuple[float, ...]]
) -> None:
    ends = [(max(KINDS[name].least, -1e5), min(KINDS[name].most, 1e5)) for name in NAMES]
    rows = [*shares, (0.0,) * len(NAMES), (1.0,) * len(NAMES)]
    values = {
        name: np.array([low + row[place] * (high - low) for row in rows])
        for place, (name, (low, high)) in enumerate(zip(NAMES, ends, strict=True))
    }
    margins = np.broadcast_to(comparison_margin(atom, values), len(rows))
    for _, holds in decided_comparisons(atom, KINDS):
        known = [float(margin) for margin in margins if math.isfinite(margin)]
        slack = 1e-9 * max([1e5, *map(abs, known)])
        assert all(margin >= -slack if holds else margin <= slack for margin in known)
