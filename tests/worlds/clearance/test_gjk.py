"""GJK against triangle distances (PQP, in FCL), most of all where boxes are aligned."""

import math

import fcl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wil_campaign.worlds.clearance.gjk import PRECISION_M, convex_distance, posed_convex_distance
from wil_campaign.worlds.frames import Quat, Vec3, quat_normalize

CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
FACES = np.array([f for a, b, c, d in SIDES for f in ((a, b, c), (a, c, d))], np.int32)

component = st.floats(-1.0, 1.0) | st.sampled_from([0.0, 0.5, 1.0, -1.0])
quats = (
    st.tuples(component, component, component, component)
    .filter(lambda q: math.hypot(*q) > 0.1)
    .map(quat_normalize)
)
coordinate = st.floats(-1.5, 1.5) | st.sampled_from([0.0, 0.25, -0.5, 1.0])
positions = st.tuples(coordinate, coordinate, coordinate)
extent = st.sampled_from([1e-4, 0.05, 0.3]) | st.floats(0.01, 2.0)
halves = st.tuples(extent, extent, extent)


def triangle_distance(body: np.ndarray, other: np.ndarray) -> float:
    solids = []
    for corners in (body, other):
        model = fcl.BVHModel()
        model.beginModel(8, 12)
        model.addSubModel(corners, FACES)
        model.endModel()
        solids.append(fcl.CollisionObject(model))
    return max(0.0, float(fcl.distance(*solids)))


def turned(corners: np.ndarray, position: Vec3, q: Quat) -> np.ndarray:
    from wil_campaign.worlds.frames import matrix_from_quat

    return np.asarray(corners @ matrix_from_quat(q).T + np.array(position))


@settings(max_examples=400, deadline=None)
@given(halves, halves, positions, quats)
def test_two_boxes(half_a: Vec3, half_b: Vec3, position: Vec3, q: Quat) -> None:
    body, other = CUBE * np.array(half_a), CUBE * np.array(half_b)
    distance, direction, at_least = posed_convex_distance(body, position, q, other)
    assert at_least <= distance + 1e-12
    assert distance - at_least <= PRECISION_M
    by_triangles = triangle_distance(turned(body, position, q), other)
    if distance > 0.0:
        assert distance == pytest.approx(by_triangles, abs=1e-6)
        assert math.hypot(*direction) == pytest.approx(1.0)
        apart = (turned(body, position, q) @ np.array(direction)).min()
        assert apart - (other @ np.array(direction)).max() == pytest.approx(at_least, abs=1e-9)
    else:
        inside = np.abs(np.array(position)) <= np.array(half_b) + math.hypot(*half_a)
        assert by_triangles < 1e-6 or inside.all()


def test_a_hovering_box_beside_a_bar_is_where_it_is() -> None:
    """The case in which libccd is a quarter off: half a turn of yaw, everything parallel."""
    body, bar = CUBE * np.array([0.15, 0.15, 0.05]), CUBE * np.array([0.05, 0.05, 0.6])
    for yaw_quarters in range(4):
        half = yaw_quarters * math.pi / 4
        q = (math.cos(half), 0.0, 0.0, math.sin(half))
        distance, _, _ = posed_convex_distance(body, (1.0, 0.55, 0.0), q, bar)
        assert distance == pytest.approx(math.hypot(0.8, 0.35), abs=1e-9)


@given(positions, positions)
def test_the_distance_of_two_points_is_exact(a: Vec3, b: Vec3) -> None:
    distance, _, _ = convex_distance(np.array([a]), np.array([b]))
    assert distance == pytest.approx(math.dist(a, b), abs=2 * PRECISION_M)


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(4, 60))
def test_hulls_of_any_points_have_bounds_that_meet(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    body = rng.normal(size=(count, 3)) * rng.uniform(0.001, 1.0, 3)
    other = rng.normal(size=(count, 3)) + rng.uniform(-4.0, 4.0, 3)
    distance, _, at_least = convex_distance(body, other)
    assert distance - at_least <= PRECISION_M
    swapped, _, _ = convex_distance(other, body)
    assert swapped == pytest.approx(distance, abs=2 * PRECISION_M)
