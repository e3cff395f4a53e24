"""Distances to triangles through a tree, against each triangle in turn, and against FCL."""

import math
from typing import Any

import fcl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wil_campaign.worlds.clearance.clearance import BoxShape, ClearanceProbe, SphereShape
from wil_campaign.worlds.clearance.gjk import convex_distance, hull_at_pose
from wil_campaign.worlds.clearance.surfaces import (
    LEAF,
    is_swept_beyond,
    surface_distance,
    triangle_tree,
)
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.parts import SolidPart, SurfaceShape
from wil_campaign.worlds.scene.scene import Scene, SceneObject
from wil_campaign.worlds.scene.shapes import Shape, box_shape

CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
BODY = CUBE * (0.15, 0.1, 0.05)
seeds = st.integers(0, 2**32 - 1)
counts = st.integers(1, 70)


def soup(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of all sizes anywhere, some of them flat on an axis, some without area."""
    middles = rng.uniform(-2, 2, (count, 1, 3))
    corners = middles + rng.normal(size=(count, 3, 3)) * rng.uniform(0.001, 0.8, (count, 1, 1))
    corners[::5, :, 2] = 0.5
    corners[::7, 2] = corners[::7, 1]
    return corners.reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def random_pose(rng: np.random.Generator) -> Pose:
    q = rng.normal(size=4)
    q /= np.linalg.norm(q)
    return Pose(tuple(rng.uniform(-2, 2, 3).tolist()), tuple(q.tolist()))


def at(pose: Pose) -> np.ndarray:
    return np.asarray(hull_at_pose(BODY, pose.position_ned_m, pose.q_wxyz))


def one_by_one(hull: np.ndarray, corners: np.ndarray, faces: np.ndarray) -> float:
    return min(float(convex_distance(hull, corners[face])[0]) for face in faces)


@settings(max_examples=150, deadline=None)
@given(seeds, counts)
def test_the_nearest_of_all_is_found(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    corners, faces = soup(rng, count)
    tree, pose = triangle_tree(corners, faces), random_pose(rng)
    found = surface_distance(BODY, pose.position_ned_m, pose.q_wxyz, tree)
    assert found == pytest.approx(one_by_one(at(pose), corners, faces), abs=1e-6)


@settings(max_examples=40, deadline=None)
@given(seeds)
def test_the_distance_to_a_surface_is_that_of_fcl(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners, pose = rng.normal(size=(30, 3)), random_pose(rng)
    faces = np.arange(30, dtype=np.int32).reshape(-1, 3)
    sides = box_shape((2.0, 2.0, 2.0)).mesh
    solids = []
    for vertices, triangles in (
        (sides.vertices_m * (0.15, 0.1, 0.05), sides.faces),
        (corners, faces),
    ):
        model = fcl.BVHModel()
        model.beginModel(len(vertices), len(triangles))
        model.addSubModel(vertices, triangles)
        model.endModel()
        solids.append(fcl.CollisionObject(model))
    solids[0].setTransform(fcl.Transform(np.array(pose.q_wxyz), np.array(pose.position_ned_m)))
    expected = max(0.0, fcl.distance(*solids))
    found = surface_distance(BODY, pose.position_ned_m, pose.q_wxyz, triangle_tree(corners, faces))
    # A body around a whole triangle touches it; FCL sees skins only.
    assert found == pytest.approx(expected, abs=1e-6) or found == 0.0


@settings(max_examples=150, deadline=None)
@given(seeds, counts, st.floats(0.0, 1.5))
def test_a_sweep_is_beyond_exactly_when_its_hull_is(seed: int, count: int, m: float) -> None:
    rng = np.random.default_rng(seed)
    corners, faces = soup(rng, count)
    first, last = random_pose(rng), random_pose(rng)
    distance = one_by_one(np.concatenate([at(first), at(last)]), corners, faces)
    begin, end = ((each.position_ned_m, each.q_wxyz) for each in (first, last))
    beyond = is_swept_beyond(BODY, begin, end, triangle_tree(corners, faces), m)
    if abs(distance - m) > 1e-6:
        assert beyond == (distance > m)


@given(seeds, counts)
def test_the_tree_holds_every_triangle_and_boxes_hold_their_children(seed: int, count: int) -> None:
    corners, faces = soup(np.random.default_rng(seed), count)
    triangles, boxes = triangle_tree(corners, faces)
    assert {each.tobytes() for each in triangles} == {each.tobytes() for each in corners[faces]}
    leaves = len(boxes) // 2
    assert len(triangles) == leaves * LEAF
    for node in range(1, leaves):
        for child in (2 * node, 2 * node + 1):
            assert (boxes[node, 0] <= boxes[child, 0]).all()
            assert (boxes[node, 1] >= boxes[child, 1]).all()
    for leaf in range(leaves):
        inside = triangles[leaf * LEAF : (leaf + 1) * LEAF]
        assert (boxes[leaves + leaf, 0] == inside.min(axis=(0, 1))).all()
        assert (boxes[leaves + leaf, 1] == inside.max(axis=(0, 1))).all()


def sheet_scene() -> Scene:
    """A level sheet of many triangles 2 m below the origin."""
    line = np.linspace(-20, 20, 41)
    north, east = np.meshgrid(line, line, indexing="ij")
    corners = np.stack([north, east, np.full_like(north, 2.0)], axis=-1).reshape(-1, 3)
    index = np.arange(41 * 41).reshape(41, 41)
    a, b = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    c, d = index[1:, 1:].ravel(), index[1:, :-1].ravel()
    faces = np.concatenate([np.stack([a, c, b], -1), np.stack([a, d, c], -1)]).astype(np.int32)
    part = SolidPart("surface", SurfaceShape(corners, faces), Pose((0.0, 0.0, 0.0)))
    shape = Shape("mesh", box_shape((1.0, 1.0, 1.0)).mesh, (part,))
    return Scene((SceneObject(1, "sheet", shape, Pose.of(0, 0, 0)),))


@pytest.mark.parametrize("body", [BoxShape((0.2, 0.2, 0.1)), SphereShape(0.1)], ids=["box", "ball"])
def test_far_along_a_sheet_takes_few_questions(
    body: BoxShape | SphereShape, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A flight along a wall or over ground keeps its distance: one look has to do."""
    asked = []

    def counted(*arguments: Any) -> float:
        asked.append(1)
        return float(surface_distance(*arguments))

    monkeypatch.setattr("wil_campaign.worlds.clearance.distance.surface_distance", counted)
    probe = ClearanceProbe(sheet_scene(), body, within_m=5.0)
    (found,) = probe.sweep(Pose.of(-9, 0.3, 0), 0.0, Pose.of(9, 0.6, 0), 9.0)
    assert found.clearance_m == pytest.approx(1.9, abs=1e-3)
    assert len(asked) <= 4


def test_diving_through_a_sheet_between_two_samples_is_hit() -> None:
    probe = ClearanceProbe(sheet_scene(), BoxShape((0.1, 0.1, 0.05)), within_m=5.0)
    (found,) = probe.sweep(Pose.of(0, 0, 40), 0.0, Pose.of(5, 0, -40), 1.0)
    assert found.clearance_m == 0.0
    assert math.isclose(found.at_s, 42 / 80, abs_tol=0.01)
