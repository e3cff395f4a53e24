"""Colours of depth images, for people who look at them."""

from collections.abc import Iterable

import cv2
import numpy as np

from wil_campaign.vehicles.readings import BgrImage, DepthImage

FAR_M = 20.0
"""Larger distances have the colour of this one, where nothing says what is seen."""
_FARS_M = (0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 10.0, 15.0, 20.0, 30.0, 50.0, 80.0, 100.0)
_NEARER = 0.99
"""This part of what an image measured is within its scale: a few stray points do not set it."""


def common_far_m(depths: Iterable[DepthImage]) -> float:
    """Return the end of one scale in metres for depth images (height, width) shown together.

    FAR_M where nothing was measured.
    """
    seen_m = [
        float(np.quantile(measured, _NEARER))
        for depth_m in depths
        if (measured := depth_m[np.isfinite(depth_m) & (depth_m > 0.0)]).size
    ]
    most_m = max(seen_m, default=FAR_M)
    return next((far_m for far_m in _FARS_M if far_m >= most_m), _FARS_M[-1])


def color_depth(depth_m: DepthImage, far_m: float = FAR_M) -> BgrImage:
    """Return a depth image (height, width) in colours; NaN and inf have the colour of far_m."""
    near = np.clip(np.nan_to_num(depth_m, nan=far_m, posinf=far_m) / far_m, 0.0, 1.0)
    grey = np.rint(255.0 * (1.0 - near)).astype(np.uint8)
    colored: BgrImage = cv2.applyColorMap(grey, cv2.COLORMAP_VIRIDIS).astype(np.uint8)
    return colored


def depth_scale(width_px: int, height_px: int) -> BgrImage:
    """Return the colours of the depths from 0 m at the left to the farthest at the right."""
    row = np.linspace(0.0, FAR_M, width_px, dtype=np.float32)
    return color_depth(np.tile(row, (height_px, 1)))
