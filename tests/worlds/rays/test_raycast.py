"""Rays in a room whose distances are known."""

import sys

import numpy as np
import pytest

from wil_campaign.worlds.frames import Pose, Vec3
from wil_campaign.worlds.rays.raycast import RaycastError, SceneRayCaster
from wil_campaign.worlds.scene import shapes
from wil_campaign.worlds.scene.motion import ObjectMotion, Waypoint
from wil_campaign.worlds.scene.scene import Scene, SceneObject

ROOM = SceneObject(3, "room", shapes.room_shape(6, 4, 2.5), Pose.of(0, 0, 0))
AT: Vec3 = (1.0, 0.5, -1.0)
NORTH, EAST, SOUTH, WEST, UP, DOWN = np.array(
    [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, -1], [0, 0, 1]], float
)


def test_each_wall_is_met_where_it_stands() -> None:
    hits = SceneRayCaster(Scene((ROOM,))).cast(
        AT, np.stack([SOUTH, WEST, NORTH, EAST, UP, DOWN]), 0.0
    )
    np.testing.assert_allclose(hits.ranges_m, [4.0, 2.5, 2.0, 1.5, 1.5, 1.0], atol=1e-5)
    assert hits.object_ids.tolist() == [3] * 6


def test_a_slanted_ray_is_as_long_as_its_way() -> None:
    slanted = (NORTH + DOWN) / np.sqrt(2.0)
    hits = SceneRayCaster(Scene((ROOM,))).cast((0.0, 0.0, -1.0), slanted[None], 0.0)
    assert hits.ranges_m[0] == pytest.approx(np.sqrt(2.0), abs=1e-5)


def test_a_ray_that_meets_nothing_is_infinite() -> None:
    hits = SceneRayCaster(Scene()).cast(AT, np.stack([NORTH, DOWN]), 0.0)
    assert np.isinf(hits.ranges_m).all()
    assert hits.object_ids.tolist() == [0, 0]


def test_a_ray_meets_a_moving_thing_where_it_is() -> None:
    way = ObjectMotion(Pose.of(2, 0, 1), (Waypoint((2.0, 1.5, -1.0), 1.0),))
    box = SceneObject(9, "box", shapes.box_shape((0.5, 0.5, 0.5)), way.begin, way)
    caster = SceneRayCaster(Scene((ROOM, box)))
    first = caster.cast((0.0, 0.0, -1.0), NORTH[None], 0.0)
    assert (first.ranges_m[0], first.object_ids[0]) == (pytest.approx(1.75), 9)
    later = caster.cast((0.0, 0.0, -1.0), NORTH[None], 1.0)
    assert (later.ranges_m[0], later.object_ids[0]) == (pytest.approx(3.0), 3)


def test_embree_has_built_its_tree_when_the_caster_is_there() -> None:
    caster = SceneRayCaster(Scene((ROOM,)))
    assert caster._resting is not None
    assert caster._resting._scene.is_committed


def test_without_embree_the_error_says_what_to_leave_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on Linux on ARM, where there is no package of it."""
    monkeypatch.setitem(sys.modules, "embreex.mesh_construction", None)
    with pytest.raises(RaycastError, match=r"not installed here .* leave them out"):
        SceneRayCaster(Scene((ROOM,)))
