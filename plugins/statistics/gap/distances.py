"""Distances between all flights of one case by one measure; pure.

Repetitions of one number have one seed in all modes, and so the same gusts and the same walk:
pairs of flights of one seed are left out of means, and intervals resample seeds. With them, modes
that fly alike were told apart in 15 % of campaigns of one case, and in 68 % of six cases, where 5 %
may be (400 simulated each, five flights; now 2 to 7 %).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from wil_campaign.plugins.statistics.gap.measures import FlightMeasure
from wil_campaign.plugins.statistics.gap.motion import RunMotion
from wil_campaign.plugins.statistics.gap.trajectory_distances import IntArray
from wil_campaign.plugins.statistics.proportions import RateInterval
from wil_campaign.worlds.jit import F64

MODES = ("real", "sim", "wil")
LEAST_SEEDS = 4
"""Seeds of each mode for an interval: of three, a quarter of the intervals misses the truth."""
_RESOLUTION = 1e-9
"""Smaller distances are rounding errors, and count as 0."""

Flights = Mapping[tuple[str, str], Sequence[RunMotion]]
"""Motions by case and mode."""


@dataclass(frozen=True, slots=True)
class CaseDistances:
    """Distances of one case. seeds: of the flights of each mode, in the order of the rows.

    sim, wil (real flights, flights of the mode): from reality to the mode. within: by mode, between
    its flights, (flights, flights). None: not flown, or not recorded by all.
    """

    seeds: Mapping[str, IntArray]
    sim: F64 | None
    wil: F64 | None
    within: Mapping[str, F64 | None]

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Return how many flights of real, sim and wil there are."""
        real, sim, wil = (len(self.seeds[mode]) for mode in MODES)
        return real, sim, wil

    @property
    def units(self) -> IntArray:
        """Return the seeds of the case's flights, each once: what the bootstrap resamples."""
        return np.unique(np.concatenate([self.seeds[mode] for mode in MODES]))

    def flight_weights(self, drawn: F64) -> Mapping[str, F64]:
        """Return the weights of each mode's flights for weights (resamples, units) of the seeds."""
        units = self.units
        return {mode: drawn[:, np.searchsorted(units, self.seeds[mode])] for mode in MODES}

    def to_reality(self, mode: str, weights: Mapping[str, F64]) -> F64 | None:
        """Return for each row of weights the mean distance of sim or wil to reality.

        Over pairs of different seeds, NaN without any. None where the mode was not flown.
        """
        between = self.sim if mode == "sim" else self.wil
        if between is None:
            return None
        mine, theirs = (self.seeds["real"], weights["real"]), (self.seeds[mode], weights[mode])
        return pair_mean(between, mine, theirs)

    def mean_within(self, mode: str) -> float | None:
        """Return the mean distance of two flights of a mode; None for fewer than two."""
        found = self.within[mode]
        if found is None or len(found) < 2:
            return None
        return float(found.sum() / (len(found) * (len(found) - 1)))


def case_distances(flights: Flights, case: str, measure: FlightMeasure) -> CaseDistances:
    """Return the distances of a case by a measure."""
    given = {mode: tuple(flights.get((case, mode), ())) for mode in MODES}
    return CaseDistances(
        seeds={
            mode: np.array([run_motion.seed for run_motion in given[mode]], np.int64)
            for mode in MODES
        },
        sim=_between(given["real"], given["sim"], measure),
        wil=_between(given["real"], given["wil"], measure),
        within={mode: _within(given[mode], measure) for mode in MODES},
    )


def pair_mean(distances: F64, rows: tuple[IntArray, F64], columns: tuple[IntArray, F64]) -> F64:
    """Return the weighted mean over pairs of different seeds; NaN without any.

    rows, columns: seeds (flights,) and weights (resamples, flights) of both sides.
    """
    (seeds, weights), (others, more) = rows, columns
    is_pair = (seeds[:, None] != others[None, :]).astype(np.float64)
    total = np.sum((weights @ (distances * is_pair)) * more, axis=1)
    count = np.sum((weights @ is_pair) * more, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        found: F64 = total / count
    return found


def equal_weights(one: CaseDistances) -> Mapping[str, F64]:
    """Return the weights of the flights as they were flown."""
    return one.flight_weights(np.ones((1, len(one.units))))


def have_enough_seeds(parts: Sequence[CaseDistances]) -> bool:
    """Return whether each mode of each part has the seeds that an interval needs."""
    counts = (len(set(seeds.tolist())) for part in parts for seeds in part.seeds.values())
    return min(counts) >= LEAST_SEEDS


def _between(
    real: Sequence[RunMotion], other: Sequence[RunMotion], measure: FlightMeasure
) -> F64 | None:
    rows = [[measure.between(run_motion, each) for each in other] for run_motion in real]
    if not real or not other or any(value is None for row in rows for value in row):
        return None
    return _rounded(np.array(rows, np.float64))


def _within(motions: Sequence[RunMotion], measure: FlightMeasure) -> F64 | None:
    found = np.zeros((len(motions), len(motions)))
    for (i, run_motion), (j, other) in combinations(enumerate(motions), 2):
        distance = measure.between(run_motion, other)
        if distance is None:
            return None
        found[i, j] = found[j, i] = distance
    return _rounded(found) if motions else None


def _rounded(distances: F64) -> F64:
    distances[distances < _RESOLUTION] = 0.0
    return distances


def mean_of_cases(values: Sequence[float | None]) -> float | None:
    """Return the mean of one value per case; None where any is missing or not finite."""
    known = [value for value in values if value is not None and math.isfinite(value)]
    return sum(known) / len(known) if known and len(known) == len(values) else None


def is_nearer(interval: RateInterval | None) -> bool | None:
    """Return whether an interval is above 0; None where it contains 0, or without one."""
    if interval is None:
        return None
    return True if interval.low > 0.0 else False if interval.high < 0.0 else None
