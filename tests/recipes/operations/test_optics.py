"""Camera models: a point of the world is seen where the new model says."""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.recipes.samples import CAMERA, HEIGHT, WIDTH, apply, build, camera, depth, plain
from wil_campaign.recipes.operations.optics import remap_between, remapped_image
from wil_campaign.recipes.working import CannotMixError, Masked
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import IDENTITY, Pose, quat_conjugate, quat_from_euler, rotate

LENS = (-0.25, 0.06, 0.001, -0.0005, 0.0)
BENT = Intrinsics(200, 150, 160.0, 158.0, 101.0, 73.0, LENS)
WIDE = Intrinsics.from_fov(240, 180, 1.3)


def seen_at(point_frd: tuple[float, float, float], lens: Intrinsics) -> tuple[float, float]:
    """OpenCV's own projection, the reference here."""
    forward, right, down = point_frd
    matrix = np.array([[lens.fx_px, 0, lens.cx_px], [0, lens.fy_px, lens.cy_px], [0, 0, 1]])
    optical = np.array([[right, down, forward]])
    pixel, _ = cv2.projectPoints(
        optical, np.zeros(3), np.zeros(3), matrix, np.array(lens.distortion or (0.0,) * 4)
    )
    return float(pixel[0, 0, 0]), float(pixel[0, 0, 1])


def spot(lens: Intrinsics, at: tuple[float, float], radius: float = 3.0) -> Any:
    v, u = np.mgrid[0 : lens.height_px, 0 : lens.width_px]
    light = 255 * np.exp(-((u - at[0]) ** 2 + (v - at[1]) ** 2) / (2 * radius**2))
    image = np.repeat(light[:, :, None], 3, axis=2).astype(np.uint8)
    return camera(image, intrinsics=lens)


def centre(image: Any) -> tuple[float, float]:
    moments = cv2.moments(image[:, :, 0])
    return moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]


@settings(deadline=None, max_examples=30)
@given(
    st.floats(-0.3, 0.3),
    st.floats(-0.2, 0.2),
    st.sampled_from([(WIDE, BENT), (BENT, WIDE), (BENT, replace(BENT, distortion=()))]),
    st.floats(-0.1, 0.1),
)
def test_a_point_is_seen_where_the_new_camera_sees_it(
    right: float, down: float, cameras: Any, yaw: float
) -> None:
    old, new = cameras
    turn = quat_from_euler(0.0, 0.05, yaw) if yaw else IDENTITY
    point = (1.0, right, down)
    work = remapped_image(Masked(spot(old, seen_at(point, old))), new, turn)
    expected = seen_at(rotate(quat_conjugate(turn), point), new)
    inside = all(
        15 < at < size - 15
        for at, size in zip(expected, (new.width_px, new.height_px), strict=True)
    )
    if inside:
        assert centre(work.reading.image_bgr) == pytest.approx(expected, abs=0.35)
        assert work.reading.intrinsics == new


def test_pixels_that_the_old_camera_did_not_see_are_not_kept() -> None:
    narrow = Intrinsics.from_fov(100, 80, 0.6)
    made = remapped_image(Masked(camera(plain(width=100, height=80), intrinsics=narrow)), WIDE)
    assert made.mask is not None
    share = (made.mask == 255).mean()
    expected = (np.tan(0.3) / np.tan(0.65)) ** 2 * (80 / 100) / (180 / 240)
    assert share == pytest.approx(expected, rel=0.05)
    assert (made.reading.image_bgr[made.mask == 0] == 0).all()
    assert (made.reading.image_bgr[made.mask == 255] == (200, 60, 30)).all()


def test_a_strong_lens_does_not_fold_the_far_outside_into_the_picture() -> None:
    fisheye = Intrinsics(200, 150, 80.0, 80.0, 99.5, 74.5, (-0.35, 0.0, 0.0, 0.0))
    maps = remap_between(fisheye, Intrinsics.from_fov(400, 300, 2.6))
    # Beyond the turning point of r (1 - 0.35 r^2), r > 0.976, nothing is seen.
    corner = np.hypot(*(np.array([0, 0]) - [199.5, 149.5])) / (200 / np.tan(1.3))
    assert corner > 0.976
    assert maps.seen[0, 0] == 0
    assert maps.seen[150, 200] == 255


def test_depth_follows_the_new_axis() -> None:
    wall = Pose((0.0, 0.0, 0.0), quat_from_euler(0.0, 0.0, 0.2))
    made = remapped_image(Masked(depth(4.0, intrinsics=CAMERA)), CAMERA, wall.q_wxyz)
    values = made.reading.depth_m[(made.mask == 255)]
    # The wall stays where it is: every point back in the old frame is 4 m ahead.
    assert made.mask is not None
    v, u = np.nonzero(made.mask == 255)
    right = (u - CAMERA.cx_px) / CAMERA.fx_px * values
    down = (v - CAMERA.cy_px) / CAMERA.fy_px * values
    back = [
        wall.to_parent(point)
        for point in zip(values.tolist(), right.tolist(), down.tolist(), strict=True)
    ]
    assert np.array(back)[:, 0] == pytest.approx(4.0, abs=1e-3)
    assert np.isinf(made.reading.depth_m[made.mask == 0]).all()


def test_pixels_that_no_ray_reaches_through_the_new_lens_are_not_kept() -> None:
    old = Intrinsics(64, 48, 25.0, 25.0, 31.5, 23.5)
    # r (1 - 0.4 r^2) turns back at r = 0.913, which is 0.609 distorted.
    new = Intrinsics(64, 48, 30.0, 30.0, 31.5, 23.5, distortion=(-0.4, 0.0, 0.0, 0.0))
    made = remapped_image(Masked(camera(intrinsics=old)), new)
    v, u = np.mgrid[0:48, 0:64]
    far = np.hypot(u - 31.5, v - 23.5) / 30.0
    assert made.mask is not None
    assert not made.mask[far > 0.62].any()
    assert made.mask[far < 0.59].all()


def test_the_same_model_changes_nothing_and_ids_are_not_mixed() -> None:
    ids = np.zeros((HEIGHT, WIDTH), np.uint8)
    ids[:, 20:40] = 200
    given_work = Masked(camera(object_ids=ids))
    assert remapped_image(given_work, CAMERA) is given_work
    made = remapped_image(given_work, replace(CAMERA, cx_px=CAMERA.cx_px + 2.4))
    assert made.reading.object_ids is not None
    assert set(np.unique(made.reading.object_ids)) == {0, 200}


def test_camera_model_takes_the_other_sides() -> None:
    other = camera(plain(width=240, height=180), "real", intrinsics=WIDE)
    assert apply("camera_model", camera(), other, to="real").reading.intrinsics == WIDE
    with pytest.raises(CannotMixError):
        apply("camera_model", camera(), to="real")
    with pytest.raises(ValueError, match="its own camera"):
        build("camera_model", to="twin")


@given(st.integers(1, 40), st.integers(1, 30), st.integers(0, 24), st.integers(0, 18))
def test_a_crop_sees_a_point_where_it_was(width: int, height: int, left: int, top: int) -> None:
    image = np.random.default_rng(1).integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    made = apply(
        "crop", camera(image), width_px=width, height_px=height, left_px=left, top_px=top
    ).reading
    assert np.array_equal(made.image_bgr, image[top : top + height, left : left + width])
    u, v = CAMERA.project((1.0, 0.1, 0.05)) or (0, 0)
    assert made.intrinsics.project((1.0, 0.1, 0.05)) == pytest.approx((u - left, v - top))
    assert (made.intrinsics.width_px, made.intrinsics.height_px) == (width, height)


def test_a_crop_is_in_the_middle_by_default_and_within_the_picture() -> None:
    values = np.arange(HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH)
    made = apply("crop", depth(values), width_px=4, height_px=2).reading
    assert made.depth_m[0, 0] == 23 * WIDTH + 30
    with pytest.raises(CannotMixError, match="does not lie within 64 x 48"):
        apply("crop", camera(), width_px=65, height_px=2)
