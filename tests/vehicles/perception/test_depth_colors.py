"""Depth images in colours, also where the sensor measured nothing."""

import warnings

import numpy as np

from wil_campaign.vehicles.perception.depth_colors import (
    FAR_M,
    color_depth,
    common_far_m,
    depth_scale,
)


def test_near_and_far_differ_and_unmeasured_depth_is_far() -> None:
    depth_m = np.array([[0.0, 5.0, 20.0, 90.0], [np.nan, np.inf, 20.0, 20.0]], np.float32)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        image = color_depth(depth_m)
    assert image.shape == (2, 4, 3)
    assert image.dtype == np.uint8
    far = image[0, 2]
    assert np.all(image[1] == far)
    assert np.all(image[0, 3] == far)
    assert len({tuple(pixel) for pixel in image[0, :3].tolist()}) == 3


def test_the_scale_has_the_colours_of_its_depths() -> None:
    scale = depth_scale(201, 2)
    assert scale.shape == (2, 201, 3)
    for column, depth_m in ((0, 0.0), (50, 5.0), (200, FAR_M)):
        assert (scale[:, column] == color_depth(np.full((2, 1), depth_m, np.float32))[:, 0]).all()


def test_the_scale_of_images_shown_together_ends_where_what_they_see_does() -> None:
    wall_m = np.full((20, 20), 2.6, np.float32)
    stray_m = wall_m.copy()
    stray_m[0, :2] = (60.0, np.inf)
    assert common_far_m([wall_m, stray_m]) == 3.0
    assert common_far_m([wall_m, 3.0 * wall_m]) == 8.0
    assert common_far_m([np.full((2, 2), np.nan, np.float32)]) == FAR_M
    assert common_far_m([1e3 * wall_m]) == 100.0
    near, end = color_depth(np.array([[1.0, 3.0]], np.float32), 3.0)[0]
    assert tuple(end) == tuple(color_depth(np.array([[FAR_M]], np.float32))[0, 0])
    assert tuple(near) != tuple(end)
