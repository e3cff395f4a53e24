"""Lidars in a room whose distances are known."""

import math
from typing import Any

import numpy as np
import pytest

from worlds.frames import Pose
from worlds.rays.lidar import LidarModel, scan
from worlds.rays.raycast import RayCaster
from worlds.scene import shapes
from worlds.scene.motion import Motion, Waypoint
from worlds.scene.scene import Scene, SceneObject

ROOM = SceneObject(3, "room", shapes.room(6, 4, 2.5), Pose.of(0, 0, 0))
FLAT = LidarModel(columns=4, horizontal_fov_rad=2 * math.pi, range_max_m=10.0)


def test_a_full_circle_meets_each_wall_once() -> None:
    seen = scan(RayCaster(Scene((ROOM,))), FLAT, Pose.of(1, 0.5, 1), 0.0)
    np.testing.assert_allclose(FLAT.azimuths_rad, [-math.pi, -math.pi / 2, 0, math.pi / 2])
    np.testing.assert_allclose(seen.ranges_m, [[4.0, 2.5, 2.0, 1.5]], atol=1e-5)
    assert (seen.object_ids == 3).all()


def test_it_turns_with_the_sensor() -> None:
    caster = RayCaster(Scene((ROOM,)))
    seen = scan(caster, FLAT, Pose.of(1, 0.5, 1, yaw_rad=math.pi / 2), 0.0)
    np.testing.assert_allclose(seen.ranges_m, [[2.5, 2.0, 1.5, 4.0]], atol=1e-5)


def test_rows_go_from_top_to_bottom() -> None:
    model = LidarModel(
        columns=1, rows=3, horizontal_fov_rad=0.0, vertical_fov_rad=math.pi / 2, range_max_m=50.0
    )
    seen = scan(RayCaster(Scene((ROOM,))), model, Pose.of(0, 0, 1), 0.0)
    root = math.sqrt(2)
    np.testing.assert_allclose(seen.ranges_m[:, 0], [1.5 * root, 3.0, root], atol=1e-5)
    assert seen.ranges_m.dtype == np.float32


def test_too_near_too_far_and_nothing_are_infinite() -> None:
    model = LidarModel(columns=4, horizontal_fov_rad=2 * math.pi, range_min_m=1.6, range_max_m=3.0)
    seen = scan(RayCaster(Scene((ROOM,))), model, Pose.of(1, 0.5, 1), 0.0)
    assert np.isinf(seen.ranges_m).tolist() == [[True, False, False, True]]
    assert seen.object_ids.tolist() == [[0, 3, 3, 0]]
    empty = scan(RayCaster(Scene()), FLAT, Pose.of(1, 0.5, 1), 0.0)
    assert np.isinf(empty.ranges_m).all()


def test_what_moves_is_met_where_it_is() -> None:
    way = Motion(Pose.of(2, 0, 1), (Waypoint((2.0, 1.5, -1.0), 1.0),))
    box = SceneObject(9, "box", shapes.box((0.5, 0.5, 0.5)), way.begin, way)
    caster = RayCaster(Scene((ROOM, box)))
    ahead = LidarModel(columns=1, horizontal_fov_rad=0.0, range_max_m=10.0)
    first = scan(caster, ahead, Pose.of(0, 0, 1), 0.0)
    assert (first.ranges_m[0, 0], first.object_ids[0, 0]) == (pytest.approx(1.75), 9)
    later = scan(caster, ahead, Pose.of(0, 0, 1), 1.0)
    assert (later.ranges_m[0, 0], later.object_ids[0, 0]) == (pytest.approx(3.0), 3)


@pytest.mark.parametrize(
    "wrong",
    [
        {"columns": 0},
        {"rows": 0},
        {"range_max_m": 0.0},
        {"range_min_m": 11.0},
        {"horizontal_fov_rad": 7.0},
        {"vertical_fov_rad": math.nan},
    ],
)
def test_impossible_scanners_are_refused(wrong: dict[str, float]) -> None:
    right: dict[str, Any] = {"columns": 4, "horizontal_fov_rad": 1.0, "range_max_m": 10.0}
    with pytest.raises(ValueError, match=r"must|at least"):
        LidarModel(**{**right, **wrong})
