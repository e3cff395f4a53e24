"""Obstacle avoidance climbs away from a box that grows, in time, and from no other."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from campaigns.autonomies.avoid import AvoidAutonomy, line_slope
from tests.campaigns.autonomies.point_mass import Corners, Flight, GeometryFinder, fly
from worlds.frames import Vec3

START_S = 4.0


def drone_at(place: Callable[[float], Vec3]) -> Corners:
    def corners(t_s: float) -> list[Vec3]:
        north, east, down = place(t_s)
        return [(north, east + side, down + low) for side in (-0.15, 0.15) for low in (-0.03, 0.05)]

    return corners


def coming(speed_m_s: float) -> Callable[[float], Vec3]:
    return lambda t_s: (2.5 - speed_m_s * max(0.0, t_s - START_S), 0.0, -1.2)


def avoid(place: Callable[[float], Vec3], noise_px: float = 1.0, **parameters: object) -> Flight:
    autonomy = AvoidAutonomy(goal={"altitude_m": 1.2}, parameters=parameters, seed=1)
    finder = GeometryFinder(drone_at(place), noise_px=noise_px)
    autonomy._finder = finder  # type: ignore[assignment]  # stands in for a detector
    return fly(autonomy, finder, 15.0)


@pytest.mark.parametrize("speed_m_s", [0.5, 1.0])
def test_it_is_above_what_flies_at_it_before_that_is_there(speed_m_s: float) -> None:
    flight = avoid(coming(speed_m_s))
    there_s = START_S + (2.5 - 0.3) / speed_m_s
    up_m = [-place[2] for t_s, place in flight.path if t_s >= there_s]
    assert min(up_m) > 1.2 + 0.2
    before = [-place[2] for t_s, place in flight.path if t_s <= START_S]
    assert max(before) < 1.25
    assert max(up_m) == pytest.approx(1.8, abs=0.1)
    assert flight.commands[-1].done


def test_a_slower_approach_is_evaded_nearer() -> None:
    at_s = {
        speed: next(t for (t, _), note in zip(f.path, f.notes(), strict=True) if note == "evade")
        for speed in (0.5, 1.0)
        for f in (avoid(coming(speed), 0.0),)
    }
    away_m = {speed: 2.5 - speed * (t - START_S) for speed, t in at_s.items()}
    assert away_m[0.5] < away_m[1.0]


@pytest.mark.parametrize(
    "place",
    [
        lambda _: (2.5, 0.0, -1.2),
        lambda t_s: (2.5 + 0.15 * t_s, 0.0, -1.2),
        lambda t_s: (2.5, 0.9 * math.sin(t_s), -1.2),
        lambda t_s: (2.5, 0.0, -min(0.1 + 0.3 * t_s, 1.2)),
    ],
    ids=["hovers", "leaves", "passes", "climbs"],
)
def test_what_does_not_come_nearer_is_not_evaded(place: Callable[[float], Vec3]) -> None:
    flight = avoid(place)
    assert set(flight.notes()) == {"watch"}
    assert all(math.dist(at, (0.0, 0.0, -1.2)) < 0.05 for _, at in flight.path)


def test_boxes_that_jump_are_no_approach() -> None:
    rises = drone_at(lambda t_s: (2.5, 0.0, -min(0.1 + 0.3 * t_s, 1.2)))
    boxes = {}
    for standard_errors in (0, 2):
        autonomy = AvoidAutonomy(
            goal={"altitude_m": 1.2}, parameters={"standard_errors": standard_errors}, seed=1
        )
        finder = GeometryFinder(rises, noise_px=2.5)
        autonomy._finder = finder  # type: ignore[assignment]  # stands in for a detector
        boxes[standard_errors] = set(fly(autonomy, finder, 15.0).notes())
    assert boxes == {0: {"watch", "evade"}, 2: {"watch"}}


def test_the_slope_of_a_line() -> None:
    slope, error = line_slope(((0.0, 1.0), (1.0, 3.0), (2.0, 5.0)))
    assert slope == pytest.approx(2.0)
    assert error == pytest.approx(0.0, abs=1e-12)
    assert line_slope(((1.0, 1.0), (1.0, 9.0))) == (0.0, 0.0)
    x, y = np.arange(8.0), np.array([1.0, 3.1, 4.9, 7.2, 8.8, 11.0, 13.3, 14.9])
    _, covariance = np.polyfit(x, y, 1, cov=True)
    _, error = line_slope(tuple(zip(x.tolist(), y.tolist(), strict=True)))
    assert error == pytest.approx(math.sqrt(covariance[0][0]))


def test_wrong_parameters_are_refused() -> None:
    with pytest.raises(ValueError, match="growth_per_s must be greater than 0"):
        AvoidAutonomy(goal={"altitude_m": 1.2}, parameters={"growth_per_s": 0}, seed=1)
