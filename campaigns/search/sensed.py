"""What the sensors of a search's flights had before them, reduced until it can be counted; pure.

A reading is reduced to what lies in reach of the vehicle: for each sector of the field of view how
near the nearest thing is, in steps that double. Distinct reduced readings measure how many
situations were flown (Hildebrandt, Elbaum and Dwyer, "PhysCov: Physical Test Coverage for
Autonomous Vehicles", ISSTA 2023). Of a camera, whose pictures have no distances, it is counted in
which sector and how far each object of the world was.
"""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

SECTORS = 8
"""Parts of equal width, of the field of view of a sensor, from its left to its right."""
EDGES_M = (0.5, 1.0, 2.0, 4.0, 8.0)
"""Between the levels of distance; beyond the last is what 4 m/s do not get to within 2 s."""
LEVELS = len(EDGES_M) + 1

Cell = tuple[int, int]
"""A sector, and a level of distance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensedView:
    """What a sensor had before it in a flight.

    object: the object of the world that is looked for; "" for whatever is nearest. sectors: of the
    sensor. cells: that were seen. reduced: distinct readings, a digit for each sector; empty for an
    object. nearest_m: None where nothing was seen. largest_share: of the field of view, 0 to 1.
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
    """What a sensor had before it in all flights of a search; object, sectors: as of a view.

    flights: that were looked at; seen: in how many of these there was anything. cells: in how many
    flights each was seen; failed: in how many that failed. reduced: how many distinct readings
    there were; newest: the flight, counted from 1, that had the last new one or the last new cell.
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
        """Return how many cells there are."""
        return self.sectors * LEVELS


@dataclass(slots=True)
class _Count:
    """A coverage while it is counted."""

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
        """Count a view of a flight."""
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


def level_of(distance_m: float) -> int:
    """Return the level of a distance, 0 for the nearest."""
    return sum(distance_m >= edge for edge in EDGES_M)


def sensed_coverage(
    flights: Iterable[tuple[tuple[SensedView, ...], bool]],
) -> tuple[SensedCoverage, ...]:
    """Return what all flights had before their sensors. flights: views, and whether it failed."""
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
