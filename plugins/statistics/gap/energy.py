"""Energy distance of each mode to reality: the gap corrected for the spread of each mode; pure.

The mean distance between flights of two modes is small where one of them has little spread, though
its flights are not like the other's. The energy distance (Szekely and Rizzo 2013) corrects for it:
twice the mean distance between two modes less the mean distances within both, 0 for modes that fly
alike. Pairs of flights of one seed are left out, as a flight is not compared with itself. The
estimate is unbiased, so it may be slightly below 0.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wil_campaign.plugins.statistics.gap.distances import (
    MODES,
    CaseDistances,
    equal_weights,
    have_enough_seeds,
    is_nearer,
    mean_of_cases,
    pair_mean,
)
from wil_campaign.plugins.statistics.gap.measures import FlightMeasure, Part
from wil_campaign.plugins.statistics.inference.bootstrap import Statistic, bootstrap_interval
from wil_campaign.plugins.statistics.proportions import RateInterval
from wil_campaign.worlds.jit import F64

_SEED = 20130830


@dataclass(frozen=True, slots=True)
class EnergyFigure:
    """One measure of one case. within_*: mean distance of two flights of one mode.

    sim, wil: energy distance of the mode to reality; None without two flights of each.
    nearer_by: sim less wil. nearer_interval: by resampling seeds; None where flights are equal or
    too few. holds: whether wil is nearer beyond chance; None where the interval contains 0, or
    where there is none.
    """

    case: str
    measure: str
    part: Part
    within_real: float | None
    within_sim: float | None
    within_wil: float | None
    sim: float | None
    wil: float | None
    nearer_by: float | None
    nearer_interval: RateInterval | None
    holds: bool | None


def energy_figure(
    case: str, measure: FlightMeasure, parts: Sequence[CaseDistances]
) -> EnergyFigure:
    """Return the figure over the parts: one case, or several with equal weights."""
    within = {mode: mean_of_cases([part.mean_within(mode) for part in parts]) for mode in MODES}
    sim, wil = (_observed(parts, mode) for mode in ("sim", "wil"))
    nearer = interval = None
    if sim is not None and wil is not None:
        nearer = sim - wil
        if have_enough_seeds(parts):
            sizes = [len(part.units) for part in parts]
            interval = bootstrap_interval(sizes, _nearer(parts), seed=_SEED)
    return EnergyFigure(
        case=case,
        measure=measure.name,
        part=measure.part,
        within_real=within["real"],
        within_sim=within["sim"],
        within_wil=within["wil"],
        sim=sim,
        wil=wil,
        nearer_by=nearer,
        nearer_interval=interval,
        holds=is_nearer(interval),
    )


def _observed(parts: Sequence[CaseDistances], mode: str) -> float | None:
    """Return the energy distance of a mode to reality, mean over the parts."""
    found = []
    for part in parts:
        energy = _energy(part, mode, equal_weights(part))
        found.append(None if energy is None else float(energy[0]))
    return mean_of_cases(found)


def _energy(one: CaseDistances, mode: str, weights: Mapping[str, F64]) -> F64 | None:
    """Return the energy distance for each row of weights of real and of the mode.

    NaN without a pair. None where the mode was not flown or did not record the measure.
    """
    apart, real, own = one.to_reality(mode, weights), one.within["real"], one.within[mode]
    if apart is None or real is None or own is None:
        return None
    mine, theirs = (one.seeds["real"], weights["real"]), (one.seeds[mode], weights[mode])
    return 2.0 * apart - pair_mean(real, mine, mine) - pair_mean(own, theirs, theirs)


def _nearer(parts: Sequence[CaseDistances]) -> Statistic:
    """Return by how much wil is nearer, for weights of the seeds of each part."""

    def statistic(weights: Sequence[F64]) -> F64:
        found = []
        for part, drawn in zip(parts, weights, strict=True):
            by_mode = part.flight_weights(drawn)
            sim, wil = _energy(part, "sim", by_mode), _energy(part, "wil", by_mode)
            if sim is None or wil is None:
                raise ValueError("a mode without distances has no energy distance")
            found.append(sim - wil)
        mean: F64 = np.mean(found, axis=0)
        return mean

    return statistic
