"""The gap to reality: by how much `wil` is nearer to it than `sim` is; pure.

diff(B(S), B(Sm)) < diff(B(S), B(Sv)): each diff is the mean distance over pairs of a flight of
reality and one of the other mode, of different seeds where there are such pairs. Intervals resample
seeds, never pairs: a pair shares its flights with others.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wil_campaign.plugins.statistics.gap.distances import (
    LEAST_SEEDS,
    CaseDistances,
    Flights,
    case_distances,
    equal_weights,
    have_enough_seeds,
    is_nearer,
    mean_of_cases,
)
from wil_campaign.plugins.statistics.gap.energy import EnergyFigure, energy_figure
from wil_campaign.plugins.statistics.gap.measures import MEASURES, FlightMeasure, Part
from wil_campaign.plugins.statistics.inference.bootstrap import Statistic, bootstrap_interval
from wil_campaign.plugins.statistics.proportions import RateInterval
from wil_campaign.worlds.jit import F64

ALL_CASES = "all cases"
_SEED = 20210530
TOO_FEW = f"fewer than {LEAST_SEEDS} seeds of a mode: no interval"


@dataclass(frozen=True, slots=True)
class GapFigure:
    """One measure of one case. real_to_*: mean distance; real_to_real: the spread of reality.

    closed_percent: how much of the gap of `sim` is closed in `wil`: 100 for all, negative where it
    is wider. nearer_by: real_to_sim less real_to_wil. The intervals are None where flights are
    equal or too few; `basis` has the reason. holds: whether wil is nearer beyond chance; None where
    the interval of nearer_by contains 0, or without one.
    """

    case: str
    measure: str
    part: Part
    text: str
    real_to_sim: float | None
    real_to_wil: float | None
    real_to_real: float | None
    closed_percent: float | None
    closed_interval: RateInterval | None
    nearer_by: float | None
    nearer_interval: RateInterval | None
    holds: bool | None
    basis: str


@dataclass(frozen=True, slots=True)
class CampaignGap:
    """The gap of a campaign. flights: their number by case and mode, as "small/wil".

    energies: the same figures as energy distances. left_out: runs that could not be compared, and
    why.
    """

    figures: tuple[GapFigure, ...] = ()
    energies: tuple[EnergyFigure, ...] = ()
    flights: Mapping[str, int] | None = None
    left_out: tuple[str, ...] = ()


def measure_gap(flights: Flights, left_out: Iterable[str] = ()) -> CampaignGap:
    """Return the gap of each case with reality and another mode, and of all complete cases."""
    cases = [
        case
        for case in dict.fromkeys(case for case, _ in flights)
        if flights.get((case, "real")) and any(flights.get((case, m)) for m in ("sim", "wil"))
    ]
    figures: list[GapFigure] = []
    energies: list[EnergyFigure] = []
    complete: dict[str, list[CaseDistances]] = {}
    for case in cases:
        for measure in MEASURES:
            distances = case_distances(flights, case, measure)
            figures.append(_figure(case, measure, [distances]))
            energies.append(energy_figure(case, measure, [distances]))
            if distances.sim is not None and distances.wil is not None:
                complete.setdefault(measure.name, []).append(distances)
    for measure in MEASURES:
        if len(found := complete.get(measure.name, [])) > 1:
            figures.append(_figure(ALL_CASES, measure, found))
            energies.append(energy_figure(ALL_CASES, measure, found))
    counts = {f"{case}/{mode}": len(motions) for (case, mode), motions in flights.items()}
    return CampaignGap(tuple(figures), tuple(energies), counts, tuple(left_out))


def _figure(case: str, measure: FlightMeasure, parts: Sequence[CaseDistances]) -> GapFigure:
    """Return the figure over the parts: one case, or several with equal weights."""
    sim, wil = (_observed(parts, mode) for mode in ("sim", "wil"))
    closed = nearer = None
    closed_interval = nearer_interval = None
    if sim is not None and wil is not None:
        nearer = sim - wil
        closed = 100.0 * (1.0 - wil / sim) if sim > 0.0 else None
        sizes = [len(part.units) for part in parts]
        if have_enough_seeds(parts):
            nearer_interval = bootstrap_interval(sizes, _nearer(parts), seed=_SEED)
        if nearer_interval is not None and closed is not None:
            closed_interval = bootstrap_interval(sizes, _closed(parts), seed=_SEED)
    return GapFigure(
        case=case,
        measure=measure.name,
        part=measure.part,
        text=measure.text,
        real_to_sim=sim,
        real_to_wil=wil,
        real_to_real=mean_of_cases([part.mean_within("real") for part in parts]),
        closed_percent=closed,
        closed_interval=closed_interval,
        nearer_by=nearer,
        nearer_interval=nearer_interval,
        holds=is_nearer(nearer_interval),
        basis=_basis(parts, nearer, nearer_interval),
    )


def _observed(parts: Sequence[CaseDistances], mode: str) -> float | None:
    """Return the mean distance of a mode to reality, mean over the parts."""
    found: list[float | None] = []
    for part in parts:
        between = part.sim if mode == "sim" else part.wil
        mean = part.to_reality(mode, equal_weights(part))
        if between is None or mean is None:
            found.append(None)
        else:
            found.append(float(mean[0] if np.isfinite(mean[0]) else between.mean()))
    return mean_of_cases(found)


def _basis(
    parts: Sequence[CaseDistances], nearer: float | None, interval: RateInterval | None
) -> str:
    """Return the number of flights behind a figure, and why it has no interval."""
    real, sim, wil = (sum(part.sizes[place] for part in parts) for place in range(3))
    counted = f"{real} real, {sim} sim, {wil} wil"
    if nearer is None:
        return f"{counted}; not all recorded the measure" if sim and wil else counted
    if interval is not None:
        return counted
    single = all(size == 1 for part in parts for size in part.sizes)
    if not single and not have_enough_seeds(parts):
        return f"{counted}; {TOO_FEW}"
    why = "one flight of each mode" if single else "equal flights: deterministic, no spread"
    return f"{counted}; {why}"


def _means(parts: Sequence[CaseDistances], weights: Sequence[F64]) -> tuple[F64, F64]:
    """Return for each resample of seeds the mean distances from reality to sim and to wil."""
    means: dict[str, list[F64]] = {"sim": [], "wil": []}
    for part, drawn in zip(parts, weights, strict=True):
        by_mode = part.flight_weights(drawn)
        for mode, found in means.items():
            mean = part.to_reality(mode, by_mode)
            if mean is None:
                raise ValueError("a mode without distances has no mean")
            found.append(mean)
    return np.mean(means["sim"], axis=0), np.mean(means["wil"], axis=0)


def _nearer(parts: Sequence[CaseDistances]) -> Statistic:
    def statistic(weights: Sequence[F64]) -> F64:
        sim, wil = _means(parts, weights)
        return sim - wil

    return statistic


def _closed(parts: Sequence[CaseDistances]) -> Statistic:
    def statistic(weights: Sequence[F64]) -> F64:
        sim, wil = _means(parts, weights)
        with np.errstate(divide="ignore", invalid="ignore"):
            found: F64 = 100.0 * (1.0 - wil / sim)
        return found

    return statistic
