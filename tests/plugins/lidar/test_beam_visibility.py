"""Ranges of a rangefinder against what geometry puts before its beam."""

from types import SimpleNamespace
from typing import Any

import pytest

from tests.recipes.samples import beam
from wil_campaign.orchestrator.run.perception.expected_views import ExpectedViews
from wil_campaign.plugins.lidar.visibility import BEAMS
from wil_campaign.recipes.visibility.model import VirtualObjects
from wil_campaign.worlds.frames import AT_ORIGIN, Pose
from wil_campaign.worlds.scene.scene import Scene, SceneObject
from wil_campaign.worlds.scene.shapes import box_shape

POST = SceneObject(1, "post", box_shape((0.2, 2.0, 2.0)), Pose((4.1, 0.0, 0.0)))
WALL = SceneObject(2, "wall", box_shape((0.2, 9.0, 9.0)), Pose((2.1, 0.0, 0.0)))


@pytest.mark.parametrize(("mixed_m", "is_unexpected"), [(4.0, True), (2.0, False)])
def test_a_post_that_is_laid_over_a_nearer_wall_is_unexpected(
    mixed_m: float, is_unexpected: bool
) -> None:
    """An overlay compares no ranges: the autonomy loses the wall."""
    measured: Any = SimpleNamespace(
        real=SimpleNamespace(options=None),
        views=ExpectedViews(real=Scene((WALL,)), virtual=Scene((POST,)), events={}),
        virtual=VirtualObjects({1: "post"}),
    )
    at: Any = SimpleNamespace(t_s=1.0, body=AT_ORIGIN, measured=measured)
    found = BEAMS.compare(beam(2.0, "real"), beam(mixed_m), at)
    assert found is not None
    assert found.is_unexpected is is_unexpected
    assert not found.objects[0].in_view
