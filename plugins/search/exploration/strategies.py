"""Strategies of a search that do not learn: grid, pairwise, Sobol points, random points."""

import heapq
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from wil_campaign.plugins.search.exploration.space import SearchSpace, Values
from wil_campaign.plugins.search.search_part import ParameterValue, StrategyName

_ATTEMPTS = 20_000
"""Inadmissible points in a row after which the space is considered exhausted."""
_SOBOL_CHUNK = 64
_MOST_LISTED = 1_000_000
"""Points of a grid that is listed: each takes some 300 bytes and 4 microseconds."""
_MOST_ROWS = 50_000
"""Combinations of levels among which pairs are looked for that a constraint cut out."""

Point = dict[str, ParameterValue]
_Row = tuple[int, ...]
"""A combination of levels: the index of each parameter's level."""


@dataclass(frozen=True, slots=True)
class StrategyProposal:
    """A proposal of a strategy. number: identifies it when its value is reported."""

    number: int
    values: Point


class MissingExtraError(Exception):
    """A package of the extra `search` is not installed; the message names it and the remedy."""

    def __init__(self, package: str, user: str) -> None:
        super().__init__(
            f"{user} needs the package {package}, which is not installed: install "
            "wil-campaign[search]"
        )


class SearchStrategy(Protocol):
    """Proposes values, and receives the value of the objective for each."""

    def ask(self) -> StrategyProposal | None:
        """Return the next proposal, which keeps the constraints; None when there are no more."""

    def tell(self, number: int, value: float | None) -> None:
        """Report the value of a proposal; None where no flight has a result."""


class FixedStrategy:
    """A strategy whose points do not depend on the values of earlier points."""

    def __init__(self, points: Iterator[Point]) -> None:
        self._points = enumerate(points)

    def ask(self) -> StrategyProposal | None:
        """Return the next point; None after the last."""
        following = next(self._points, None)
        return None if following is None else StrategyProposal(*following)

    def tell(self, number: int, value: float | None) -> None:
        """Ignore the value."""


def fixed_points(name: StrategyName, space: SearchSpace, seed: int) -> Iterator[Point]:
    """Return the points of a strategy that does not learn. Raises MissingExtraError."""
    makers: dict[str, Callable[[SearchSpace, int], Iterator[Point]]] = {
        "grid": _grid,
        "pairwise": _pairwise,
        "sobol": _sobol,
        "random": _random,
    }
    return makers[name](space, seed)


def random_point(space: SearchSpace, rng: np.random.Generator) -> Point | None:
    """Return a random admissible point; None where no attempt was admissible."""
    for _ in range(_ATTEMPTS):
        point = space.at(rng.random(len(space.parameters)).tolist())
        if space.admits(point):
            return point
    return None


def _grid(space: SearchSpace, seed: int) -> Iterator[Point]:
    """Return the grid in random order by the seed, so that a part of it covers all of the space.

    A grid too large to list is drawn point by point.
    """
    names = [parameter.name for parameter in space.parameters]
    levels = [parameter.levels for parameter in space.parameters]
    counts = [len(values) for values in levels]
    if math.prod(counts) > _MOST_LISTED:
        rng = np.random.default_rng(seed)
        rows = (rng.integers(counts).tolist() for _ in _forever())
        drawn = ([values[i] for values, i in zip(levels, row, strict=True)] for row in rows)
        return _unseen(space, (dict(zip(names, point, strict=True)) for point in drawn))
    points = list(space.grid())
    order = np.random.default_rng(seed).permutation(len(points))
    return (points[index] for index in order)


def _pairwise(space: SearchSpace, seed: int) -> Iterator[Point]:
    """Return points that together contain each admissible pair of levels (greedily).

    covertable knows no constraints: what a row that breaks one leaves out is added after its rows.
    """
    try:
        from covertable import make  # noqa: PLC0415 - of an extra
    except ModuleNotFoundError as error:
        raise MissingExtraError("covertable", "the strategy pairwise") from error
    # Indices, as covertable treats True and 1 as the same level.
    levels = {parameter.name: parameter.levels for parameter in space.parameters}
    strength = min(2, len(levels))
    made = make(
        {name: list(range(len(values))) for name, values in levels.items()},
        strength=strength,
        salt=str(seed),
    )

    def point_of(row: _Row) -> Point:
        return {name: levels[name][index] for name, index in zip(levels, row, strict=True)}

    def is_admitted(row: _Row) -> bool:
        return space.admits(point_of(row))

    every = [tuple(row[name] for name in levels) for row in made]
    rows = [row for row in every if is_admitted(row)]
    if len(rows) < len(every):
        grid = _grid_rows([len(values) for values in levels.values()], seed)
        rows = [*rows, *_added_rows(rows, filter(is_admitted, grid), strength)]
    return map(point_of, rows)


def _grid_rows(counts: Sequence[int], seed: int) -> Iterator[_Row]:
    """Return the rows of a grid of levels; of a large one as many random ones, by the seed."""
    if math.prod(counts) <= _MOST_ROWS:
        return itertools.product(*map(range, counts))
    drawn = np.random.default_rng(seed).integers(counts, size=(_MOST_ROWS, len(counts)))
    return map(tuple, drawn.tolist())


def _added_rows(rows: Iterable[_Row], candidates: Iterable[_Row], strength: int) -> Iterator[_Row]:
    """Yield candidates until all of their pairs of levels are contained, the richest first."""

    def pairs_of(row: _Row) -> set[tuple[tuple[int, int], ...]]:
        return set(itertools.combinations(enumerate(row), strength))

    known = {pair for row in rows for pair in pairs_of(row)}
    queue = [(-len(new), row) for row in candidates if (new := pairs_of(row) - known)]
    heapq.heapify(queue)
    while queue:
        count, row = heapq.heappop(queue)
        # What a row adds only becomes less: the first whose number still holds adds the most.
        new = pairs_of(row) - known
        if len(new) == -count:
            known |= new
            yield row
        elif new:
            heapq.heappush(queue, (-len(new), row))


def _sobol(space: SearchSpace, seed: int) -> Iterator[Point]:
    from scipy.stats import qmc

    sequence = qmc.Sobol(len(space.parameters), rng=np.random.default_rng(seed))
    rows = (row for _ in _forever() for row in sequence.random(_SOBOL_CHUNK).tolist())
    return _unseen(space, map(space.at, rows))


def _random(space: SearchSpace, seed: int) -> Iterator[Point]:
    rng = np.random.default_rng(seed)
    rows = (rng.random(len(space.parameters)).tolist() for _ in _forever())
    return _unseen(space, map(space.at, rows))


def _forever() -> Iterator[int]:
    return iter(int, 1)


def _unseen(space: SearchSpace, points: Iterator[Point]) -> Iterator[Point]:
    """Yield admissible points once each; end after many in a row without one."""
    seen: set[tuple[tuple[bool, ParameterValue], ...]] = set()
    missed = 0
    for point in points:
        key = point_key(point)
        missed += 1
        if key not in seen and space.admits(point):
            seen.add(key)
            missed = 0
            yield point
        if missed >= _ATTEMPTS:
            return


def point_key(point: Values) -> tuple[tuple[bool, ParameterValue], ...]:
    """Return a hashable key of a point: true is not 1, which is equal in Python."""
    return tuple((isinstance(value, bool), value) for value in point.values())
