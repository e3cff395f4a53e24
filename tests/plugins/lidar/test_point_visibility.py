"""What mixed point clouds show of virtual objects, against what geometry puts before the beams."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from wil_campaign.plugins.lidar.visibility import (
    _some_beams,
    compare_points,
    nearest_point_distances_m,
)
from wil_campaign.recipes.visibility.model import FrameVisibility, ObjectVisibility, VirtualObjects

WALL = 2
VIRTUAL = VirtualObjects({WALL: "wall"})


def wall_of(frame: FrameVisibility) -> ObjectVisibility:
    (wall,) = frame.objects
    return wall


def points(range_m: float, count: int = 40) -> NDArray[np.float64]:
    """Return points of a wall ahead, across 4 m."""
    right = np.linspace(-2.0, 2.0, count)
    return np.stack([np.full(count, range_m), right, np.zeros(count)], axis=1)


def cloud(range_m: float | None) -> FrameVisibility:
    floor = np.stack(
        [np.linspace(1.0, 8.0, 50), np.zeros(50), np.ones(50)], axis=1, dtype=np.float32
    )
    mixed = floor
    if range_m is not None:
        mixed = np.concatenate([floor, points(range_m).astype(np.float32)])
    due = points(4.0)
    return compare_points(
        t_s=1.0,
        real_m=floor,
        mixed_m=mixed,
        expected_m=due,
        ids=np.full(len(due), WALL, np.uint8),
        virtual=VIRTUAL,
    )


def test_points_of_a_wall_are_shown_displaced_or_missing() -> None:
    right, late, none = wall_of(cloud(4.0)), wall_of(cloud(5.0)), wall_of(cloud(None))
    assert (right.is_shown, right.is_displaced, right.shown) == (True, False, 1.0)
    assert late.is_displaced
    assert late.offset == pytest.approx(1.0, abs=0.05)
    assert (none.in_view, none.is_shown, none.offset) == (True, False, None)


@pytest.mark.parametrize("thickness_m", [0.0, 1.5], ids=["wall", "bush"])
def test_the_nearest_points_are_scipys_to_the_bit(thickness_m: float) -> None:
    from scipy.spatial import cKDTree

    rng = np.random.default_rng(3)
    found = rng.uniform(-2.0, 2.0, (800, 3)) * (thickness_m, 1.0, 1.0)
    due = rng.normal(0.0, 2.0, (300, 3))
    near_m = nearest_point_distances_m(due, found.astype(np.float32))
    assert np.array_equal(near_m, cKDTree(found.astype(np.float32)).query(due)[0])
    assert nearest_point_distances_m(due[:1], np.zeros((1, 3), np.float32)) == pytest.approx(
        np.linalg.norm(due[0])
    )


@pytest.mark.parametrize(("columns", "cast"), [(90, 90), (375, 375), (750, 375)])
def test_only_some_beams_of_a_large_lidar_are_cast(columns: int, cast: int) -> None:
    pattern = SimpleNamespace(columns=columns, rings=8, lowest_rad=-0.2, highest_rad=0.2)
    lidar: Any = SimpleNamespace(pattern=pattern)
    assert len(_some_beams(lidar)) == cast * pattern.rings
