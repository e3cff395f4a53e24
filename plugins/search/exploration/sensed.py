"""Sensor coverage of a search: what was in view in its flights, reduced to sectors; pure.

A reading is reduced to the level of distance of the nearest object in each sector of the field of
view; the edges of the levels double. The number of distinct reduced readings measures how many
situations were flown (Hildebrandt, Elbaum and Dwyer, "PhysCov: Physical Test Coverage for
Autonomous Vehicles", ISSTA 2023). For a camera, whose images have no distances, the sector and
distance of each object of the world are counted.
"""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

SECTORS = 8
"""Number of parts of equal width of a sensor's field of view, counted from its left."""
EDGES_M = (0.5, 1.0, 2.0, 4.0, 8.0)
"""Edges between the levels of distance; at 4 m/s the last one is 2 s away."""
LEVELS = len(EDGES_M) + 1

Cell = tuple[int, int]
"""A sector, and a level of distance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensedView:
    """What was in view of a sensor in a flight.

    object: the object of the world that is counted; "" for the nearest of all. sectors: of the
    sensor. cells: those with something in view. reduced: distinct reduced readings, a digit for
    each sector; empty for an object. nearest_m: None where nothing was in view. largest_share: of
    the field of view, 0 to 1.
    """

    sensor: str
    object: str = ""
    sectors: int = SECTORS
    cells: tuple[Cell, ...] = ()
    reduced: tuple[str, ...] = ()
    nearest_m: float | None = None
    largest_share: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SensedCoverage:
    """What was in view of a sensor in all flights of a search; object, sectors: see SensedView.

    flights: number of evaluated flights; seen: of those with anything in view. cells: number of
    flights by cell; failed: of failed flights. reduced: number of distinct reduced readings;
    newest: the flight, counted from 1, with the latest new reading or new cell.
    """

    sensor: str
    object: str
    sectors: int
    flights: int
    seen: int
    cells: Mapping[Cell, int]
    failed: Mapping[Cell, int]
    reduced: int
    newest: int
    nearest_m: float | None
    largest_share: float

    @property
    def of_cells(self) -> int:
        """Return the number of all cells."""
        return self.sectors * LEVELS


@dataclass(slots=True)
class _Count:
    """The counters of one sensor's coverage."""

    sectors: int
    flights: int = 0
    seen: int = 0
    newest: int = 0
    cells: Counter[Cell] = field(default_factory=Counter)
    failed: Counter[Cell] = field(default_factory=Counter)
    reduced: set[str] = field(default_factory=set)
    nearest_m: float | None = None
    largest_share: float = 0.0

    def add(self, view: SensedView, *, number: int, failed: bool) -> None:
        self.flights += 1
        self.seen += view.nearest_m is not None
        if not (self.cells.keys() >= set(view.cells) and self.reduced >= set(view.reduced)):
            self.newest = number
        self.cells.update(view.cells)
        self.failed.update(view.cells if failed else ())
        self.reduced.update(view.reduced)
        known = [one for one in (self.nearest_m, view.nearest_m) if one is not None]
        self.nearest_m = min(known, default=None)
        self.largest_share = max(self.largest_share, view.largest_share)


def sensed_level_of(distance_m: float) -> int:
    """Return the level of a distance, 0 for the nearest."""
    return sum(distance_m >= edge for edge in EDGES_M)


def sensed_coverage(
    flights: Iterable[tuple[tuple[SensedView, ...], bool]],
) -> tuple[SensedCoverage, ...]:
    """Return the sensor coverage of all flights. flights: views, and whether the flight failed."""
    counts: dict[tuple[str, str], _Count] = {}
    for number, (views, failed) in enumerate(flights, start=1):
        for view in views:
            count = counts.setdefault((view.sensor, view.object), _Count(view.sectors))
            count.add(view, number=number, failed=failed)
    return tuple(
        SensedCoverage(
            sensor=sensor,
            object=name,
            sectors=count.sectors,
            flights=count.flights,
            seen=count.seen,
            cells=dict(sorted(count.cells.items())),
            failed=dict(sorted(count.failed.items())),
            reduced=len(count.reduced),
            newest=count.newest,
            nearest_m=count.nearest_m,
            largest_share=count.largest_share,
        )
        for (sensor, name), count in counts.items()
    )
