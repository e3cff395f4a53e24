"""Merges: priority with soft edge and occlusion, replacement, aggregation, points, sound."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from tests.recipes.samples import (
    HEIGHT,
    WIDTH,
    beam,
    build,
    camera,
    depth,
    fix,
    plain,
    scan,
)
from wil_campaign.recipes.working import CannotMixError, Masked

RED, GREEN, WHITE = (0, 0, 255), (0, 255, 0), (255, 255, 255)


def merged(name: str, real: Any, twin: Any, /, *, mask: Any = None, **options: Any) -> Any:
    above = Masked(twin, None if mask is None else np.where(mask, 255, 0).astype(np.uint8))
    return build(name, stage="merge", **options)({"real": Masked(real), "twin": above})


def disc(radius: float = 12.0) -> Any:
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    return np.hypot(u - 32, v - 24) <= radius


def object_on_white() -> Any:
    """A red disc before a white wall: a halo would be white."""
    image = plain(WHITE)
    image[disc()] = RED
    return image


@pytest.mark.parametrize("width_px", [0.0, 1.0, 3.0, 8.0])
def test_a_soft_edge_fades_inward_and_has_no_halo(width_px: float) -> None:
    mixed = merged(
        "overlay",
        camera(plain(GREEN), "real"),
        camera(object_on_white()),
        mask=disc(),
        soft_edge_px=width_px,
    ).image_bgr.astype(int)
    assert (mixed[~disc()] == GREEN).all()
    assert (mixed[..., 0] == 0).all()  # nothing of the white wall anywhere
    assert (abs(mixed[..., 1] + mixed[..., 2] - 255) <= 1).all()
    assert tuple(mixed[24, 32]) == RED
    row = mixed[24, 20:33, 2]
    assert (np.diff(row) >= 0).all()
    if width_px:
        soft = np.count_nonzero((row > 0) & (row < 255))
        assert soft == pytest.approx(width_px, abs=1.0)


def test_a_soft_edge_is_none_where_the_picture_ends() -> None:
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[:, :10] = True
    mixed = merged(
        "overlay",
        camera(plain(GREEN), "real"),
        camera(plain(RED)),
        mask=mask,
        soft_edge_px=4.0,
    ).image_bgr
    assert tuple(mixed[0, 0]) == RED
    assert tuple(mixed[HEIGHT - 1, 2]) == RED
    assert 0 < mixed[20, 9, 2] < 255
    nothing = merged(
        "overlay",
        camera(plain(GREEN), "real"),
        camera(),
        mask=np.zeros_like(mask),
        soft_edge_px=4.0,
    )
    assert (nothing.image_bgr == GREEN).all()


@given(
    npst.arrays(np.float32, (6, 8), elements=st.floats(0, 10, width=32)),
    npst.arrays(np.float32, (6, 8), elements=st.floats(0, 10, width=32)),
    npst.arrays(np.bool_, (6, 8)),
)
def test_a_nearer_pixel_hides_a_farther_one(far: Any, near: Any, mask: Any) -> None:
    small = {"width": 8, "height": 6}
    real = camera(plain(GREEN, **small), "real", depth_m=far)
    twin = camera(plain(RED, **small), depth_m=near)
    for occlusion in ("by_depth", "where_known"):
        mixed = merged("overlay", real, twin, mask=mask, occlusion=occlusion).image_bgr
        assert np.array_equal((mixed == RED).all(axis=2), mask & (near <= far))
    mixed = merged("overlay", real, twin, mask=mask, occlusion="none").image_bgr
    assert np.array_equal((mixed == RED).all(axis=2), mask)


def test_occlusion_needs_both_depths_when_it_is_asked_for() -> None:
    twin = camera(plain(RED), depth_m=np.full((HEIGHT, WIDTH), 2, np.float32))
    with pytest.raises(CannotMixError, match="real has no depth") as caught:
        merged("overlay", camera(source="real"), twin, occlusion="by_depth")
    assert caught.value.reason == "no_depth"
    shown = merged("overlay", camera(source="real"), twin, occlusion="where_known")
    assert (shown.image_bgr == RED).all()


def test_overlays_of_other_sensors() -> None:
    values = np.full((HEIGHT, WIDTH), 5.0)
    mixed = merged("overlay", depth(values, "real"), depth(3.0), mask=disc()).depth_m
    assert np.array_equal(mixed == 3.0, disc())
    hidden = merged("overlay", depth(values, "real"), depth(9.0), mask=disc()).depth_m
    assert (hidden == 5.0).all()
    beams = merged("overlay", scan([1, 2, 3], "real"), scan([7, 8, 9]), mask=[True, False, True])
    assert beams.ranges_m.tolist() == [7, 2, 9]
    assert merged("overlay", beam(1, "real"), beam(2), mask=[False]).range_m == 1
    assert merged("overlay", beam(1, "real"), beam(2), mask=[True]).range_m == 2
    assert merged("overlay", fix(1, 2, "real"), fix(3, 4)).latitude_deg == 3
    with pytest.raises(CannotMixError, match="resample_beams"):
        merged("overlay", scan([1, 2, 3], "real"), scan([7, 8]))


def test_a_full_turn_is_not_laid_over_its_mirror_image() -> None:
    ahead = scan(np.ones(361), "real", step_rad=np.radians(1))
    mirrored = scan(np.ones(361), start_angle_rad=np.pi, step_rad=-np.radians(1))
    with pytest.raises(CannotMixError, match="resample_beams"):
        merged("overlay", ahead, mirrored)
    assert merged("overlay", ahead, replace(ahead, start_angle_rad=np.pi)).ranges_m.all()
