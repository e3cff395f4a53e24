"""What geometry says that a sensor shows, and where it cannot know."""

import math

import numpy as np
import pytest

from wil_campaign.orchestrator.run.perception.expected_views import ExpectedViews
from wil_campaign.recipes.visibility.model import VirtualObjects
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.scene import Scene, SceneObject
from wil_campaign.worlds.scene.shapes import box_shape

WALL_M = 3.0
CAMERA = Intrinsics.from_fov(64, 48, math.radians(60.0))
WALL = SceneObject(2, "wall", box_shape((0.1, 9.0, 9.0)), Pose((WALL_M, 0.0, 0.0)))


@pytest.mark.parametrize(
    ("real_m", "unknown"), [(None, None), (WALL_M - 0.5, True), (WALL_M + 0.5, False)]
)
def test_an_object_behind_a_real_surface_is_unknown(
    real_m: float | None, unknown: bool | None
) -> None:
    views = ExpectedViews(real=Scene(), virtual=Scene((WALL,)), events={})
    depth_m = None if real_m is None else np.full((48, 64), real_m, np.float32)
    expected = views.image(
        Pose((0.0, 0.0, 0.0)),
        CAMERA,
        0.0,
        virtual=VirtualObjects({2: "wall"}),
        real_depth_m=depth_m,
    )
    assert (expected.ids == 2).all()
    if unknown is None:
        assert expected.unknown is None
    else:
        assert expected.unknown is not None
        assert (expected.unknown == unknown).all()


def test_what_a_wall_of_the_world_file_hides_is_known_but_for_its_outline() -> None:
    box = SceneObject(1, "box", box_shape((0.5, 0.5, 0.5)), Pose((6.0, 0.0, 0.0)))
    half = SceneObject(2, "wall", box_shape((0.1, 9.0, 9.0)), Pose((WALL_M, 4.5, 0.0)))
    for wall, share in ((WALL, 1.0), (half, 0.5)):
        views = ExpectedViews(real=Scene((wall,)), virtual=Scene((box,)), events={})
        seen = VirtualObjects({1: "box"})
        found = views.image(Pose((0.0, 0.0, 0.0)), CAMERA, 0.0, virtual=seen, real_depth_m=None)
        assert found.hidden is not None
        assert found.unknown is not None
        own = found.ids == 1
        assert found.unknown[own].mean() == pytest.approx(share, abs=0.15)
        assert (found.hidden <= found.unknown).all()
        assert found.hidden[own].mean() == (1.0 if wall is WALL else pytest.approx(0.35, abs=0.15))
