"""Soft mattes: antialiased edges and thin bars over another ground, without the old background."""

from typing import Any

import cv2
import numpy as np
import pytest

from tests.recipes.samples import build, camera
from wil_campaign.recipes.steps.merge.overlays import has_cover
from wil_campaign.recipes.working import Masked
from wil_campaign.vehicles.readings import BgrImage

ORANGE, GREY, GREEN = (0, 110, 230), (160, 120, 90), (60, 200, 60)
FINE = 8
BARS = ((10.4, 12.4, 5.0, 40.0), (20.0, 21.5, 5.0, 40.0), (30.3, 45.6, 10.2, 35.7))
"""left, right, top, bottom in pixels: two thin bars, and one that has an inside."""


def antialiased(ground: tuple[int, int, int]) -> BgrImage:
    """The bars over a ground, drawn FINE times as large and averaged."""
    large = np.full((48 * FINE, 64 * FINE, 3), ground, np.uint8)
    for bar in BARS:
        left, right, top, bottom = (round(edge * FINE) for edge in bar)
        large[top:bottom, left:right] = ORANGE
    small: BgrImage = cv2.resize(large, (64, 48), interpolation=cv2.INTER_AREA)
    return small


def over_green(*filters: tuple[str, dict[str, Any]], merge: Any = None) -> BgrImage:
    work: Any = Masked(camera(antialiased(GREY)))
    for name, parameters in filters:
        work = build(name, **parameters)(work, None)
    ground = Masked(camera(np.full((48, 64, 3), GREEN, np.uint8), "real"))
    mixed: BgrImage = build("overlay", **(merge or {}))({"twin": work, "real": ground}).image_bgr
    return mixed


def error(image: BgrImage) -> float:
    """Mean difference from the bars as they look over green, where there is any bar."""
    wanted, plain = antialiased(GREEN), np.full((48, 64, 3), GREEN, np.uint8)
    apart = np.abs(image.astype(int) - wanted.astype(int)).max(axis=2)
    return float(apart[np.abs(wanted.astype(int) - plain).max(axis=2) > 0].mean())


BY_COLOR = ("isolate_color", {"name": "orange"})


def test_edges_and_thin_bars_survive_without_their_old_background() -> None:
    hard, shrunk = (
        over_green(BY_COLOR),
        over_green((BY_COLOR[0], {"name": "orange", "shrink_px": 1})),
    )
    soft = over_green(BY_COLOR, ("matte", {"width_px": 1}))
    assert error(soft) < 4.0
    assert 10.0 < error(hard) < error(shrunk)
    assert (shrunk[20, 10:13] == GREEN).all()  # the bar of two pixels is gone
    assert np.abs(soft[20, 11].astype(int) - ORANGE).max() <= 2
    assert (soft[5:30, 2] == GREEN).all()


def test_the_inside_and_what_is_far_from_the_part_stay_as_they_are() -> None:
    work: Any = Masked(camera(antialiased(GREY)))
    kept = build("isolate_color", name="orange")(work, None)
    soft = build("matte", width_px=1)(kept, None)
    assert (soft.mask[15:30, 33:43] == 255).all()
    assert (soft.mask[:, :7] == 0).all()
    assert has_cover(soft.mask)
    assert not has_cover(kept.mask)
    assert (soft.reading.image_bgr[:, :7] == kept.reading.image_bgr[:, :7]).all()
    assert build("matte")(Masked(work.reading), None).mask is None
    nothing = Masked(work.reading, np.zeros((48, 64), np.uint8))
    assert build("matte")(nothing, None) is nothing


def test_an_object_beside_the_part_is_no_share_of_it() -> None:
    image = np.full((48, 64, 3), GREY, np.uint8)
    image[10:30, 10:20] = ORANGE
    image[10:30, 20:22] = (60, 0, 230)
    mask = np.zeros((48, 64), np.uint8)
    mask[10:30, 10:20] = 255
    soft: Any = build("matte", width_px=1)(Masked(camera(image), mask), None)
    assert (soft.mask[13:27, 20] == 0).all()


@pytest.mark.parametrize("edge_px", [0.0, 2.0])
def test_a_soft_edge_fades_what_a_matte_leaves_of_a_pixel(edge_px: float) -> None:
    mixed = over_green(BY_COLOR, ("matte", {"width_px": 1}), merge={"soft_edge_px": edge_px})
    weight = np.abs(mixed[20].astype(int) - GREEN).max(axis=1)
    assert weight[38] > 150
    assert 0 < weight[30] < weight[31] <= weight[38]
