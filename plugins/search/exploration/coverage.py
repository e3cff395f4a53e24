"""Coverage of a search's space: which pairs of levels were flown, and where it is unexplored; pure.

Pairs, as most failures need no more than two parameters (Kuhn, Wallace and Gallo, IEEE TSE 30,
2004). Each choice is a cell. A range is divided into as many cells as its `steps`, so that whole
numbers of a range that has more of them share cells.
"""

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from wil_campaign.plugins.search.exploration.space import SearchSpace, SpaceParameter, Values
from wil_campaign.plugins.search.exploration.strategies import Point

_CellPair = tuple[int, int, int, int]
"""Two parameters, each followed by its cell."""

_SAMPLES = 4096
"""Number of points that sample the space for admissible cells and the farthest point."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SpaceCoverage:
    """How much of a space was flown.

    cells, flown: number of admissible pairs of cells of two parameters (of cells, if there is only
    one), and how many of these were flown. farthest: the admissible point that is farthest from all
    flown ones, None where all were flown; distance: to the nearest of these, as a share of the
    ranges (root mean square over the parameters).
    """

    cells: int
    flown: int
    farthest: Point | None
    distance: float

    @property
    def share(self) -> float:
        """Return the share of admissible cells that were flown."""
        return self.flown / self.cells if self.cells else 0.0


def space_coverage_of(space: SearchSpace, tried: Iterable[Values]) -> SpaceCoverage:
    """Return how much of a space variants cover."""
    samples = admissible_shares(space)
    points = [point for values in tried if (point := space.shares(values)) is not None]
    flown = {cell for shares in points for cell in _cells(space, shares)}
    farthest, distance = _farthest(samples, points)
    return SpaceCoverage(
        cells=_admissible_count(space, samples, flown),
        flown=len(flown),
        farthest=None if farthest is None else space.at(farthest),
        distance=distance,
    )


def admissible_shares(space: SearchSpace) -> list[tuple[float, ...]]:
    """Return the places in the unit cube of evenly spread values that keep the constraints."""
    from scipy.stats import qmc

    sequence = qmc.Sobol(len(space.parameters), scramble=False)
    points = map(space.at, sequence.random(_SAMPLES).tolist())
    places = (space.shares(point) for point in points if space.admits(point))
    return [place for place in places if place is not None]


def cell_of(parameter: SpaceParameter, share: float) -> int:
    """Return the cell of a parameter in which a share of its range lies."""
    count = cell_count(parameter)
    return min(max(int(share * count), 0), count - 1)


def cell_count(parameter: SpaceParameter) -> int:
    """Return the number of cells of a parameter."""
    if parameter.choices:
        return len(parameter.choices)
    count = parameter.count
    return parameter.steps if count is None else min(count, max(parameter.steps, 2))


def _admissible_count(
    space: SearchSpace, samples: Iterable[Sequence[float]], flown: set[_CellPair]
) -> int:
    """Return the number of pairs of cells that the constraints admit, by the samples."""
    if not space.constraints:
        counts = [cell_count(parameter) for parameter in space.parameters]
        return sum(a * b for a, b in itertools.combinations(counts, 2)) or counts[0]
    # A flown variant is admissible even if no sample is in its cell.
    return len({cell for shares in samples for cell in _cells(space, shares)} | flown)


def _cells(space: SearchSpace, shares: Sequence[float]) -> Iterable[_CellPair]:
    own = [
        cell_of(parameter, share) for parameter, share in zip(space.parameters, shares, strict=True)
    ]
    if len(own) == 1:
        yield (0, own[0], 0, own[0])
    for first, second in itertools.combinations(range(len(own)), 2):
        yield (first, own[first], second, own[second])


def _farthest(
    samples: Sequence[tuple[float, ...]], points: Sequence[tuple[float, ...]]
) -> tuple[tuple[float, ...] | None, float]:
    if not samples:
        return None, 0.0
    if not points:
        return samples[0], 1.0
    every, flown = np.array(samples), np.array(points)
    nearest = np.full(len(every), np.inf)
    for point in flown:
        nearest = np.minimum(nearest, np.sum((every - point) ** 2, axis=1))
    index = int(np.argmax(nearest))
    if nearest[index] == 0.0:
        return None, 0.0
    return samples[index], math.sqrt(float(nearest[index]) / every.shape[1])
