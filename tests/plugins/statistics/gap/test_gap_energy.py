"""The energy distance between modes, against its definition, closed forms and scipy."""

from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from tests.orchestrator.reading.flown_campaign import flights, write_flown
from wil_campaign.plugins.statistics.gap.energy import EnergyFigure
from wil_campaign.plugins.statistics.gap.gap import ALL_CASES, CampaignGap, measure_gap
from wil_campaign.plugins.statistics.gap.motion import RunMotion
from wil_campaign.plugins.statistics.pass_rates import PassRates
from wil_campaign.plugins.statistics.study import Study
from wil_campaign.plugins.statistics.study_tables import energy_rows, gap_rows
from wil_campaign.worlds.jit import F64

NORTH_M = np.linspace(0.0, 4.0, 41)
SPREAD = (-0.02, -0.01, 0.0, 0.01, 0.02)
SHIFTS = {"real": 0.0, "sim": 0.9, "wil": 0.2}


def motion(east_m: float, seed: int) -> RunMotion:
    """Return a straight flight beside the way: all its distances to another are that of east_m."""
    positions = np.stack([NORTH_M, np.full(41, east_m), np.full(41, -1.2)], axis=1)
    nothing = np.zeros((0, 3))
    return RunMotion(positions, "", nothing, nothing, seed)


def motions(easts_m: Sequence[float], first_seed: int = 1) -> list[RunMotion]:
    return [motion(east_m, seed) for seed, east_m in enumerate(easts_m, first_seed)]


def gap_of(real: Sequence[float], sim: Sequence[float], wil: Sequence[float]) -> CampaignGap:
    given = {"real": real, "sim": sim, "wil": wil}
    return measure_gap({("a", mode): motions(easts_m) for mode, easts_m in given.items()})


def energy_in(gap: CampaignGap, measure: str = "dtw", case: str = "a") -> EnergyFigure:
    return next(
        energy for energy in gap.energies if (energy.measure, energy.case) == (measure, case)
    )


def by_definition(
    one: Sequence[RunMotion], other: Sequence[RunMotion]
) -> tuple[float, float, float]:
    """Return 2 E|X - Y| - E|X - X'| - E|Y - Y'| and both spreads, of the pairs of other seeds."""

    def mean(first: Sequence[RunMotion], second: Sequence[RunMotion]) -> float:
        pairs = [(a, b) for a, b in product(first, second) if a.seed != b.seed]
        easts = [(a.positions_ned_m[0, 1], b.positions_ned_m[0, 1]) for a, b in pairs]
        return float(sum(abs(x - y) for x, y in easts) / len(easts))

    within = mean(one, one), mean(other, other)
    return 2.0 * mean(one, other) - sum(within), *within


@pytest.mark.parametrize("measure", ["dtw", "frechet", "rmse"])
def test_the_distance_is_that_of_its_definition(measure: str) -> None:
    rng = np.random.default_rng(4)
    real, sim, wil = rng.normal(0.0, 0.3, 6), rng.normal(0.2, 0.05, 4), rng.normal(0.0, 0.3, 5)
    found = energy_in(gap_of(list(real), list(sim), list(wil)), measure)
    to_sim, within_real, within_sim = by_definition(motions(list(real)), motions(list(sim)))
    to_wil, _, within_wil = by_definition(motions(list(real)), motions(list(wil)))
    assert found.sim == pytest.approx(to_sim)
    assert found.wil == pytest.approx(to_wil)
    assert found.within_real == pytest.approx(within_real)
    assert found.within_sim == pytest.approx(within_sim)
    assert found.within_wil == pytest.approx(within_wil)
    assert found.nearer_by == pytest.approx(to_sim - to_wil)


def test_a_mode_without_spread_in_the_middle_is_nearer_by_its_mean_and_not_by_energy() -> None:
    wide = [-0.4, -0.2, 0.0, 0.2, 0.4]
    gap = gap_of(real=wide, sim=[0.0] * 5, wil=wide)
    mean = next(figure for figure in gap.figures if figure.measure == "dtw")
    assert mean.nearer_by is not None
    assert mean.nearer_by < 0.0
    found = energy_in(gap)
    # Flights of one seed are alike in real and wil: what is left of both spreads cancels.
    assert found.wil == pytest.approx(0.0, abs=1e-12)
    # The mean of |x| over pairs of other seeds is 0.24, the mean of |x - x'| is 0.4.
    assert found.sim == pytest.approx(2 * 0.24 - 0.4)
    assert found.within_real == pytest.approx(0.4)
    assert found.within_sim == 0.0


def test_a_shift_without_spread_is_twice_its_length() -> None:
    found = energy_in(gap_of(real=[0.0] * 3, sim=[0.4] * 3, wil=[0.1] * 3))
    assert found.sim == pytest.approx(0.8)
    assert found.wil == pytest.approx(0.2)
    assert found.nearer_interval is None
    assert found.holds is None


def test_flights_of_one_seed_are_left_out_whatever_their_order() -> None:
    easts_m = [-0.4, 0.1, 0.3]
    reversed_wil = list(reversed(motions(easts_m)))
    given = {("a", "real"): motions(easts_m), ("a", "wil"): reversed_wil}
    assert energy_in(measure_gap(given)).wil == pytest.approx(0.0, abs=1e-12)
    apart = {("a", "real"): motions(easts_m), ("a", "wil"): motions(easts_m, first_seed=11)}
    # With pairs of equal flights the mean distance between both is 2/3 of that within.
    within = (0.5 + 0.7 + 0.2) / 3.0
    assert energy_in(measure_gap(apart)).wil == pytest.approx(2 * within * 2 / 3 - 2 * within)


def _nearer_by(places: F64, real: F64, sim: F64, wil: F64) -> float:
    """Return it for drawn repetitions; a repetition drawn twice is one and the same."""
    drawn = places.astype(np.int64)
    is_pair = drawn[:, None] != drawn[None, :]

    def mean(first: F64, second: F64) -> float:
        return float(np.abs(first[drawn][:, None] - second[drawn][None, :])[is_pair].mean())

    energies = [2 * mean(real, one) - mean(real, real) - mean(one, one) for one in (sim, wil)]
    return energies[0] - energies[1]


def test_the_interval_agrees_with_scipys() -> None:
    stats = pytest.importorskip("scipy.stats")
    rng = np.random.default_rng(7)
    real, sim, wil = rng.normal(0.0, 0.3, 12), rng.normal(0.6, 0.1, 12), rng.normal(0.0, 0.3, 12)
    found = energy_in(gap_of(list(real), list(sim), list(wil)))
    reference = stats.bootstrap(
        (np.arange(12),),
        lambda places: _nearer_by(places, real, sim, wil),
        vectorized=False,
        n_resamples=2000,
        method="BCa",
        random_state=np.random.default_rng(2),
    ).confidence_interval
    assert found.nearer_interval is not None
    ends = (found.nearer_interval.low, found.nearer_interval.high)
    assert ends == pytest.approx((reference.low, reference.high), abs=0.02)
    assert found.holds is True


def test_the_answer_is_no_or_undecided_where_the_interval_is_below_or_around_0() -> None:
    real, near, far = [0.0, 0.1, 0.2, 0.3, 0.4], [0.1, 0.3, 0.0, 0.2, 0.5], [0.9, 1.0, 0.8, 1.2, 1]
    assert energy_in(gap_of(real, sim=near, wil=far)).holds is False
    assert energy_in(gap_of(real, sim=near, wil=[0.3, 0.0, 0.1, 0.5, 0.2])).holds is None


def test_all_cases_count_alike_and_a_single_flight_has_no_energy() -> None:
    shapes = {"a": ([0.0] * 3, [0.4] * 3, [0.1] * 3), "b": ([0.0] * 2, [0.2] * 2, [0.1] * 2)}
    given = {
        (case, mode): motions(easts_m)
        for case, easts in shapes.items()
        for mode, easts_m in zip(("real", "sim", "wil"), easts, strict=True)
    }
    whole = energy_in(measure_gap(given), case=ALL_CASES)
    assert whole.sim == pytest.approx(0.6)
    assert whole.wil == pytest.approx(0.2)
    alone = energy_in(gap_of(real=[0.0, 0.1], sim=[0.4], wil=[0.1, 0.2]))
    assert (alone.sim, alone.nearer_by, alone.within_sim) == (None, None, None)
    assert alone.wil is not None


def test_the_table_says_why_there_is_no_answer(tmp_path: Path) -> None:
    given = [
        flight
        for case, spread in (("a", [0.0] * 3), ("b", [0.01, 0.02]), ("c", SPREAD))
        for mode, shift, wide in (("real", 0.0, 1.0), ("wil", 0.1, 1.0), ("sim", 0.4, 0.5))
        for flight in flights(case, mode, "P" * len(spread), [shift + wide * x for x in spread])
    ]
    folder = write_flown(tmp_path / "a", given)
    rows = energy_rows(Study.read(folder)).rows
    answers = {row[0]: row[-1] for row in rows if row[2] == "frechet"}
    assert answers == {"a": "no spread", "b": "no interval", "c": "yes", ALL_CASES: "no interval"}


@pytest.mark.parametrize("few", ["real", "sim", "wil"])
def test_a_mode_of_few_flights_gives_no_interval_and_shows_nothing(few: str) -> None:
    """By one flight of a mode, half of such intervals left out the true value."""
    rng = np.random.default_rng(5)
    wide = {mode: [shift + x for x in rng.normal(0.0, 0.1, 20)] for mode, shift in SHIFTS.items()}
    for count, is_known in ((1, False), (3, False), (4, True)):
        gap = gap_of(**(wide | {few: wide[few][:count]}))
        mean = next(figure for figure in gap.figures if figure.measure == "dtw")
        assert (mean.nearer_interval is not None, mean.holds) == (is_known, is_known or None)
        assert mean.basis.endswith("of a mode: no interval") is not is_known
        assert (energy_in(gap).nearer_interval is not None) is is_known
        answer = "yes" if is_known else "no interval"
        study = Study(PassRates((), (), ()), gap)
        assert next(row[-1] for row in gap_rows(study).rows if row[2] == "dtw") == answer


def test_an_energy_distance_of_three_seeds_has_no_interval() -> None:
    """A quarter of such intervals left out the true value."""
    rng = np.random.default_rng(5)
    wide = {mode: [shift + x for x in rng.normal(0.0, 0.1, 4)] for mode, shift in SHIFTS.items()}
    assert energy_in(gap_of(**wide)).nearer_interval is not None
    three = energy_in(gap_of(**{mode: easts_m[:3] for mode, easts_m in wide.items()}))
    assert (three.nearer_interval, three.holds) == (None, None)
    assert three.nearer_by is not None


def test_one_flight_of_each_mode_has_distances_though_its_seed_is_one() -> None:
    one = next(each for each in gap_of([0.0], [0.4], [0.1]).figures if each.measure == "dtw")
    assert one.real_to_sim == pytest.approx(0.4)
    assert one.real_to_wil == pytest.approx(0.1)
    assert one.basis == "1 real, 1 sim, 1 wil; one flight of each mode"


def test_pairs_of_one_seed_make_no_mode_nearer() -> None:
    """The surrogate flies a seed alike in `real` and `wil`; `sim` is of the same distribution."""
    rng = np.random.default_rng(7)
    shown = 0
    for _ in range(20):
        real, other = rng.normal(0.0, 0.1, (2, 5))
        near = real + rng.normal(0.0, 0.005, 5)
        gap = gap_of(real=list(real), sim=list(other), wil=list(near))
        shown += next(one for one in gap.figures if one.measure == "dtw").holds is True
    assert shown <= 2
