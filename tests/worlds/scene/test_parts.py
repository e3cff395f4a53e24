"""Openings: where a path goes through."""

import math
from itertools import pairwise

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from wil_campaign.worlds.frames import Pose, Vec3
from wil_campaign.worlds.scene.parts import BoxShape, ObjectOpening

SQUARE = ObjectOpening("opening", "square", 0.5)
RING = ObjectOpening("opening", "ring", 0.5)
coordinate = st.floats(-3.0, 3.0)
points = st.tuples(coordinate, coordinate, coordinate)


def test_through_the_middle_forwards_and_back() -> None:
    crossing = SQUARE.crossing((-1.0, 0.0, 0.0), (3.0, 0.0, 0.0))
    assert crossing is not None
    assert (crossing.fraction, crossing.offset_m, crossing.direction) == (0.25, 0.0, 1)
    back = SQUARE.crossing((3.0, 0.0, 0.0), (-1.0, 0.0, 0.0))
    assert back is not None
    assert (back.fraction, back.direction) == (0.75, -1)


def test_offset_is_the_larger_side_in_a_square_and_radial_in_a_ring() -> None:
    path = ((-1.0, 0.3, -0.4), (1.0, 0.3, -0.4))
    square, ring = SQUARE.crossing(*path), RING.crossing(*path)
    assert square is not None
    assert ring is not None
    assert square.offset_m == pytest.approx(0.4)
    assert ring.offset_m == pytest.approx(0.5)


def test_beside_the_opening_is_a_crossing_with_a_large_offset() -> None:
    crossing = SQUARE.crossing((-1.0, 2.0, 0.0), (1.0, 2.0, 0.0))
    assert crossing is not None
    assert crossing.offset_m > SQUARE.limit_m


def test_an_opening_may_be_turned_in_its_thing() -> None:
    opening = ObjectOpening("side", "ring", 0.5, Pose.of(0, 2, 0, yaw_rad=math.pi / 2))
    crossing = opening.crossing((0.1, 1.0, 0.0), (0.1, 4.0, 0.0))
    assert crossing is not None
    assert crossing.fraction == pytest.approx(1 / 3)
    assert crossing.offset_m == pytest.approx(0.1)
    assert crossing.direction == 1


@given(points, points)
def test_it_crosses_exactly_when_the_side_changes(a: Vec3, b: Vec3) -> None:
    crossing = SQUARE.crossing(a, b)
    assert (crossing is not None) == ((a[0] > 0) != (b[0] > 0))
    if crossing is not None:
        assert 0.0 <= crossing.fraction <= 1.0
        assert crossing.direction == (1 if b[0] > a[0] else -1)


@given(st.lists(points, min_size=3, max_size=12))
def test_exactly_one_of_consecutive_steps_crosses(path: list[Vec3]) -> None:
    """Crossings alternate, and their sum is the change of side, also for points in the plane."""
    steps = [SQUARE.crossing(a, b) for a, b in pairwise(path)]
    total = sum(step.direction for step in steps if step is not None)
    assert total == (path[-1][0] > 0) - (path[0][0] > 0)


@given(points, points)
def test_the_way_back_crosses_at_the_same_place(a: Vec3, b: Vec3) -> None:
    there, back = RING.crossing(a, b), RING.crossing(b, a)
    assume(there is not None)
    assert there is not None
    assert back is not None
    assert back.offset_m == pytest.approx(there.offset_m, abs=1e-9)
    assert back.fraction == pytest.approx(1.0 - there.fraction, abs=1e-9)


def test_a_box_has_its_bounding_radius() -> None:
    assert BoxShape((1.0, 2.0, 2.0)).radius_m == 3.0
