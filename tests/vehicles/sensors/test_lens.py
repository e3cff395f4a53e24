"""Pictures through a lens: where OpenCV's own projection puts things."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.vehicles.cameras.rendered_cameras import RenderedImage
from wil_campaign.vehicles.sensors.lens import LensImage, ThroughLens, lens_fault, lens_map
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

PLAIN = Intrinsics.from_fov(320, 240, 1.2)
BARREL = replace(PLAIN, distortion=(-0.28, 0.07, 0.0008, -0.0005, 0.0))
DOT = (3.0, 1.1, -0.7)
"""Metres forward, right, down."""


class OneDot:
    """Draws one white dot of 7 pixels, at its place in a plain pinhole; keeps what was asked."""

    def __init__(self) -> None:
        self.asked: list[Intrinsics] = []

    def picture(
        self,
        camera_pose: Pose,
        intrinsics: Intrinsics,
        t_s: float,
        *,
        want_depth: bool = False,
        want_ids: bool = False,
    ) -> RenderedImage:
        self.asked.append(intrinsics)
        size = (intrinsics.height_px, intrinsics.width_px)
        image, ids = np.zeros((*size, 3), np.uint8), np.zeros(size, np.uint8)
        depth = np.full(size, np.inf, np.float32)
        pixel = intrinsics.project(DOT)
        assert pixel is not None
        u, v = (round(value) for value in pixel)
        image[v - 3 : v + 4, u - 3 : u + 4] = 255
        ids[v - 3 : v + 4, u - 3 : u + 4] = 7
        depth[v - 3 : v + 4, u - 3 : u + 4] = 3.0
        return LensImage(image, depth if want_depth else None, ids if want_ids else None)


def truly_at(intrinsics: Intrinsics) -> tuple[float, float]:
    i = intrinsics
    matrix = np.array([[i.fx_px, 0, i.cx_px], [0, i.fy_px, i.cy_px], [0, 0, 1.0]])
    point = np.array([[DOT[1], DOT[2], DOT[0]]])
    pixels, _ = cv2.projectPoints(point, np.zeros(3), np.zeros(3), matrix, np.array(i.distortion))
    u, v = pixels.ravel().tolist()
    return u, v


def test_things_are_seen_where_the_lens_puts_them() -> None:
    seen = ThroughLens(OneDot()).picture(
        Pose((0, 0, 0)), BARREL, 0.0, want_depth=True, want_ids=True
    )
    assert seen.image_bgr.shape == (240, 320, 3)
    assert seen.object_ids is not None
    rows, columns = np.nonzero(seen.object_ids)
    u, v = truly_at(BARREL)
    assert (columns.mean(), rows.mean()) == pytest.approx((u, v), abs=0.7)
    plain = PLAIN.project(DOT)
    assert plain is not None
    assert abs(plain[0] - u) > 4.0  # or the test would show nothing
    assert seen.depth_m is not None
    assert seen.depth_m[rows, columns] == pytest.approx(3.0)
    bright = np.nonzero(seen.image_bgr[:, :, 0] > 128)
    assert bright[1].mean() == pytest.approx(u, abs=0.7)


def test_every_pixel_of_the_lens_is_seen_by_the_wide_pinhole() -> None:
    found = lens_map(BARREL)
    for plane, size in ((found.u_px, found.wide.width_px), (found.v_px, found.wide.height_px)):
        assert plane.shape == (240, 320)
        assert plane.min() >= 1.0
        assert plane.max() <= size - 2.0


def test_a_camera_without_distortion_is_rendered_as_it_is() -> None:
    dot = OneDot()
    seen = ThroughLens(dot).picture(Pose((0, 0, 0)), PLAIN, 0.0)
    ThroughLens(dot).picture(Pose((0, 0, 0)), replace(PLAIN, distortion=(0.0,) * 5), 0.0)
    assert dot.asked == [PLAIN, PLAIN]
    assert seen.depth_m is None


def test_a_lens_that_folds_over_is_refused() -> None:
    folding = replace(PLAIN, distortion=(-2.3, 0.1, 0.0, 0.0, 0.0))
    assert "folds" in lens_fault(folding)
    with pytest.raises(ValueError, match="folds"):
        lens_map(folding)
    pincushion = replace(PLAIN, distortion=(0.3, 0.0, 0.0, 0.0))
    assert lens_fault(pincushion) == ""
    assert lens_map(pincushion).wide.width_px < PLAIN.width_px


@given(
    k1=st.floats(-0.3, 0.3),
    k2=st.floats(-0.05, 0.05),
    p1=st.floats(-0.002, 0.002),
    p2=st.floats(-0.002, 0.002),
)
def test_a_distorted_pixel_and_its_plain_one_are_the_same_ray(
    k1: float, k2: float, p1: float, p2: float
) -> None:
    small = Intrinsics.from_fov(64, 48, 1.2)
    camera = replace(small, distortion=(k1, k2, p1, p2))
    if not any(camera.distortion) or lens_fault(camera):
        return
    found = lens_map(camera)
    x = (found.u_px - found.wide.cx_px) / found.wide.fx_px
    y = (found.v_px - found.wide.cy_px) / found.wide.fy_px
    rays = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1).astype(np.float64)
    matrix = np.array(
        [[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1.0]]
    )
    pixels, _ = cv2.projectPoints(
        rays, np.zeros(3), np.zeros(3), matrix, np.array([k1, k2, p1, p2])
    )
    v, u = np.mgrid[0:48, 0:64]
    wanted = np.stack([u.ravel(), v.ravel()], axis=1)
    assert np.abs(pixels.reshape(-1, 2) - wanted).max() < 0.6
