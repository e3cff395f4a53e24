"""What sensors saw over all flights: cells, distinct readings, the flight of the last new one."""

import pytest

from wil_campaign.plugins.search.exploration.sensed import (
    EDGES_M,
    LEVELS,
    SensedView,
    sensed_coverage,
    sensed_level_of,
)


def seen(*cells: tuple[int, int], reduced: tuple[str, ...] = (), near_m: float = 1.0) -> SensedView:
    return SensedView(
        sensor="camera",
        object="gate",
        cells=cells,
        reduced=reduced,
        nearest_m=near_m if cells else None,
        largest_share=0.1 * len(cells),
    )


@pytest.mark.parametrize(("distance_m", "level"), [(0.0, 0), (0.5, 1), (1.99, 2), (8.0, 5)])
def test_levels_double_and_the_last_is_beyond_reach(distance_m: float, level: int) -> None:
    assert sensed_level_of(distance_m) == level
    assert sensed_level_of(EDGES_M[-1] * 10) == LEVELS - 1


def test_cells_count_flights_and_those_that_failed() -> None:
    flights = [
        ((seen((0, 1), (1, 1)),), False),
        ((seen((0, 1), near_m=0.4),), True),
        ((seen(),), False),
    ]
    (one,) = sensed_coverage(flights)
    assert (one.flights, one.seen) == (3, 2)
    assert dict(one.cells) == {(0, 1): 2, (1, 1): 1}
    assert dict(one.failed) == {(0, 1): 1}
    assert one.of_cells == 8 * LEVELS
    assert (one.nearest_m, one.largest_share) == (0.4, 0.2)
    assert one.newest == 1


def test_the_last_new_reading_or_cell_is_known_by_its_flight() -> None:
    first = seen((0, 1), reduced=("11",))
    flights = [first, first, seen((0, 1), reduced=("11", "12")), first, seen((2, 1))]
    assert sensed_coverage((((flight,), False)) for flight in flights[:2])[0].newest == 1
    assert sensed_coverage((((flight,), False)) for flight in flights[:4])[0].newest == 3
    (one,) = sensed_coverage((((flight,), False)) for flight in flights)
    assert (one.newest, one.reduced) == (5, 2)


def test_an_unseen_object_has_no_distance_and_each_sensor_counts_alone() -> None:
    other = SensedView(sensor="lidar", cells=((0, 5),), reduced=("5",), nearest_m=9.0)
    gate, lidar = sensed_coverage([((seen(), other), False)])
    assert (gate.seen, gate.nearest_m, gate.newest) == (0, None, 0)
    assert (lidar.sensor, lidar.object, lidar.reduced) == ("lidar", "", 1)
    assert sensed_coverage([]) == ()
