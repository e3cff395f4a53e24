"""The geometry of images as recipes give it."""

from tests.recipes.samples import (
    apply,
    camera,
)
from wil_campaign.worlds.camera import Intrinsics


def test_a_camera_part_has_the_defaults_of_a_pinhole() -> None:
    part = {"width_px": 4, "height_px": 2, "fx_px": 3.0}
    assert apply("camera_model", camera(), to=part).reading.intrinsics == Intrinsics(
        4, 2, 3.0, 3.0, 1.5, 0.5
    )
