"""Colours of depth images, for people who look at them."""

import cv2
import numpy as np

from wil_campaign.vehicles.readings import BgrImage, DepthImage

FAR_M = 20.0
"""Larger distances have the colour of this one."""


def color_depth(depth_m: DepthImage) -> BgrImage:
    """Return a depth image (height, width) in colours; NaN and inf have the colour of far."""
    near = np.clip(np.nan_to_num(depth_m, nan=FAR_M, posinf=FAR_M) / FAR_M, 0.0, 1.0)
    grey = np.rint(255.0 * (1.0 - near)).astype(np.uint8)
    colored: BgrImage = cv2.applyColorMap(grey, cv2.COLORMAP_VIRIDIS).astype(np.uint8)
    return colored


def depth_scale(width_px: int, height_px: int) -> BgrImage:
    """Return the colours of the depths from 0 m at the left to FAR_M at the right."""
    row = np.linspace(0.0, FAR_M, width_px, dtype=np.float32)
    return color_depth(np.tile(row, (height_px, 1)))
