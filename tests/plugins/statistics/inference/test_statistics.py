"""Statistics against published values, brute force and scipy.stats."""

import itertools
from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wil_campaign.plugins.statistics.gap.trajectory_distances import (
    cheapest_alignment,
    dtw_distance_m,
    frechet_distance_m,
    time_aligned_rmse_m,
)
from wil_campaign.plugins.statistics.inference.bootstrap import F64, bootstrap_interval
from wil_campaign.plugins.statistics.inference.exact_tests import (
    PassCounts,
    fisher_exact,
    stratified_exact,
    stratified_rounded,
)


def test_fishers_test_gives_what_is_published() -> None:
    # Fisher's tea: Agresti, Categorical Data Analysis, section 3.5.2.
    assert fisher_exact(PassCounts(3, 4), PassCounts(1, 4)) == pytest.approx(0.4857, abs=1e-4)
    assert fisher_exact(PassCounts(1, 4), PassCounts(3, 4), "less") == pytest.approx(
        0.2429, abs=1e-4
    )
    assert fisher_exact(PassCounts(5, 5), PassCounts(1, 5)) == pytest.approx(0.0476, abs=1e-4)
    assert fisher_exact(PassCounts(5, 5), PassCounts(4, 5)) == 1.0
    assert fisher_exact(PassCounts(30, 30), PassCounts(21, 30)) == pytest.approx(0.0019, abs=1e-4)
    assert fisher_exact(PassCounts(0, 0), PassCounts(3, 5)) == 1.0


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.tuples(*[st.integers(0, 3)] * 4), min_size=1, max_size=3),
    st.sampled_from(["two-sided", "less"]),
)
def test_the_stratified_test_is_that_of_all_outcomes(
    strata: list[tuple[int, int, int, int]], alternative: str
) -> None:
    tables = [(PassCounts(a, a + b), PassCounts(c, c + d)) for a, b, c, d in strata]
    weights: dict[int, int] = {}
    ranges = [range(one.passed + other.passed + 1) for one, other in tables]
    for outcome in itertools.product(*ranges):
        weight = 1
        for count, (one, other) in zip(outcome, tables, strict=True):
            rest = one.passed + other.passed - count
            weight *= comb(one.flown, count) * comb(other.flown, rest)
        weights[sum(outcome)] = weights.get(sum(outcome), 0) + weight
    seen = sum(one.passed for one, _ in tables)
    chosen = (
        [weight for count, weight in weights.items() if count <= seen]
        if alternative == "less"
        else [weight for weight in weights.values() if weight <= weights[seen]]
    )
    expected = sum(chosen) / sum(weights.values())
    found = stratified_exact(tables, "less" if alternative == "less" else "two-sided")
    assert found == pytest.approx(expected)


@settings(max_examples=100, deadline=None)
@given(
    st.lists(
        st.tuples(*[st.tuples(st.integers(0, 30), st.integers(0, 30)).map(sorted)] * 2),
        min_size=1,
        max_size=3,
    )
)
def test_the_rounded_test_agrees_with_the_exact_one(drawn: list[list[list[int]]]) -> None:
    tables = [(PassCounts(*one), PassCounts(*other)) for one, other in drawn]
    assert stratified_rounded(tables) == pytest.approx(stratified_exact(tables), abs=1e-9)


def test_the_rounded_test_of_a_nearly_impossible_result_is_zero() -> None:
    assert stratified_rounded([(PassCounts(0, 2000), PassCounts(2000, 2000))]) == pytest.approx(0.0)


def test_the_bootstrap_agrees_with_scipys() -> None:
    stats = pytest.importorskip("scipy.stats")
    rng = np.random.default_rng(3)
    one, other = rng.exponential(1.0, 20), rng.normal(0.0, 1.0, 15)
    found = bootstrap_interval(
        [20, 15], lambda weights: weights[0] @ one - weights[1] @ other, seed=1
    )
    reference = stats.bootstrap(
        (one, other),
        lambda a, b, axis: a.mean(axis=axis) - b.mean(axis=axis),
        vectorized=True,
        method="BCa",
        random_state=np.random.default_rng(2),
    ).confidence_interval
    assert found is not None
    assert (found.low, found.high) == pytest.approx((reference.low, reference.high), abs=0.04)


def test_equal_runs_have_no_interval() -> None:
    equal = np.full(5, 0.7)
    assert bootstrap_interval([5], lambda weights: weights[0] @ equal, seed=1) is None
    assert bootstrap_interval([1], lambda weights: weights[0] @ np.array([2.0]), seed=1) is None


LINE = np.stack([np.linspace(0.0, 4.0, 41), np.zeros(41), np.zeros(41)], axis=1)


def test_distances_of_known_trajectories() -> None:
    beside = LINE + np.array([0.0, 0.5, 0.0])
    for distance in (dtw_distance_m, frechet_distance_m, time_aligned_rmse_m):
        assert distance(LINE, LINE) == 0.0
        assert distance(LINE, beside) == pytest.approx(0.5)
        assert distance(beside, LINE) == pytest.approx(0.5)


def test_time_matters_to_one_of_them_alone() -> None:
    late = np.concatenate([np.repeat(LINE[:1], 10, 0), LINE])
    assert dtw_distance_m(LINE, late) == pytest.approx(0.0)
    assert frechet_distance_m(LINE, late) == pytest.approx(0.0)
    # 30 samples 1 m behind, then 0.9 to 0 m while the first stands at its end, of 51.
    expected = np.sqrt((sum((k / 10) ** 2 for k in range(10)) * 2 + 31 * 1.0) / 51)
    assert time_aligned_rmse_m(LINE, late) == pytest.approx(expected)


def test_a_detour_lengthens_the_leash_and_hardly_the_mean() -> None:
    spike = LINE.copy()
    spike[20, 1] = 2.0
    assert frechet_distance_m(LINE, spike) == pytest.approx(2.0)
    assert dtw_distance_m(LINE, spike) < 0.1


def _frechet_of(one: F64, other: F64, i: int, j: int) -> float:
    """Return it by its definition (Eiter and Mannila)."""
    apart = float(np.linalg.norm(one[i] - other[j]))
    before = [
        _frechet_of(one, other, a, b)
        for a, b in ((i - 1, j), (i, j - 1), (i - 1, j - 1))
        if a >= 0 and b >= 0
    ]
    return max(apart, min(before)) if before else apart


def test_the_distance_is_that_of_its_definition() -> None:
    rng = np.random.default_rng(1)
    for _ in range(5):
        one, other = rng.normal(size=(5, 3)), rng.normal(size=(6, 3))
        assert frechet_distance_m(one, other) == pytest.approx(_frechet_of(one, other, 4, 5))


def _warping_paths(rows: int, columns: int) -> list[list[tuple[int, int]]]:
    """Return all alignments of so many samples with so many: the first, the last, no step back."""
    if rows == 0 or columns == 0:
        return []
    if rows == columns == 1:
        return [[(0, 0)]]
    before = ((rows - 1, columns), (rows, columns - 1), (rows - 1, columns - 1))
    end = (rows - 1, columns - 1)
    return [[*path, end] for sizes in before for path in _warping_paths(*sizes)]


def test_the_alignment_is_the_cheapest_of_all() -> None:
    rng = np.random.default_rng(2)
    for _ in range(5):
        one, other = rng.normal(size=(5, 3)), rng.normal(size=(6, 3))
        apart = np.linalg.norm(one[:, None] - other[None], axis=2)
        best = min(_warping_paths(5, 6), key=lambda path: sum(apart[pair] for pair in path))
        ours, theirs = cheapest_alignment(one, other)
        assert list(zip(ours.tolist(), theirs.tolist(), strict=True)) == best
        assert dtw_distance_m(one, other) == pytest.approx(np.mean([apart[pair] for pair in best]))
