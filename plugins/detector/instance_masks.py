"""Masks of an instance-segmentation network (YOLO -seg): its prototypes, combined per detection."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.vehicles.readings import Mask

Plane = NDArray[np.float32]


def prototypes_of(outputs: Sequence[NDArray[np.generic]]) -> tuple[int, Plane | None]:
    """Return which output has the candidates, and the prototypes (m, height, width) of another.

    None for a network without: of one output.
    """
    for index, output in enumerate(outputs):
        if output.ndim == 4 and output.shape[0] == 1 and len(outputs) == 2:
            return 1 - index, np.asarray(output[0], np.float32)
    return 0, None


def instance_mask(
    coefficients: Plane,
    prototypes: Plane,
    *,
    box_px: Sequence[float],
    placed_px: tuple[float, float, float],
    input_px: tuple[int, int],
    image_px: tuple[int, int],
) -> Mask:
    """Return the mask of a detection: (height, width) uint8 of the image, 255 is the object.

    A pixel is of it where the sum of the prototypes, weighted by the coefficients (m,), is above 0
    (a sigmoid of 0.5), and within its box, left to bottom in the image. placed_px: left, top and
    scale of the image in the network's input; input_px, image_px: width and height.
    As YOLACT (Bolya et al., 2019) does, and Ultralytics' networks.
    """
    count, down, across = prototypes.shape
    logits: Plane = (coefficients @ prototypes.reshape(count, -1)).reshape(down, across)
    left_px, top_px, scale = placed_px
    width_px, height_px = image_px
    # Pixel centres: of the image to the input, of the input to the prototypes.
    ratios = across / input_px[0] * scale, down / input_px[1] * scale
    u = (np.arange(width_px) + 0.5) * ratios[0] + left_px * across / input_px[0] - 0.5
    v = (np.arange(height_px) + 0.5) * ratios[1] + top_px * down / input_px[1] - 0.5
    u_px, v_px = np.meshgrid(u.astype(np.float32), v.astype(np.float32))
    shown = cv2.remap(logits, u_px, v_px, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    mask = np.zeros((height_px, width_px), np.uint8)
    left, top, right, bottom = (round(edge) for edge in box_px)
    box = slice(top, bottom), slice(left, right)
    mask[box] = np.where(shown[box] > 0.0, 255, 0)
    return mask
