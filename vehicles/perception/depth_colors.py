"""Colours of depth images, for people who look at them."""

import cv2
import numpy as np

from wil_campaign.vehicles.readings import BgrImage, DepthImage

_FAR_M = 20.0
"""Larger distances have the colour of this one."""


def color_depth(depth_m: DepthImage) -> BgrImage:
    """Return a depth image (height, width) in colours; NaN and inf have the colour of far."""
    near = np.clip(np.nan_to_num(depth_m, nan=_FAR_M, posinf=_FAR_M) / _FAR_M, 0.0, 1.0)
    grey = np.rint(255.0 * (1.0 - near)).astype(np.uint8)
    colored: BgrImage = cv2.applyColorMap(grey, cv2.COLORMAP_VIRIDIS).astype(np.uint8)
    return colored
