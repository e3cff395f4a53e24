"""Soft edges: blend a layer over the ground, with a weight that rises from the layer's edge."""

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.vehicles.readings import BgrImage, Mask


def has_cover(mask: Mask) -> bool:
    """Return whether a mask has pixels that the kept part covers in part (1 to 254)."""
    return bool(cv2.countNonZero(cv2.inRange(mask, 1, 254)))


def blend_cover(layer_bgr: BgrImage, mask: Mask, ground_bgr: BgrImage) -> None:
    """Write the layer into `ground_bgr`, each pixel by the cover that its mask states."""
    cv2.copyTo(layer_bgr, cv2.compare(mask, 255, cv2.CMP_EQ), ground_bgr)
    rows, columns = np.nonzero(cv2.inRange(mask, 1, 254))
    weight = mask[rows, columns].astype(np.float32) / np.float32(255)
    upper, lower = (one[rows, columns].astype(np.float32) for one in (layer_bgr, ground_bgr))
    mixed = lower + (upper - lower) * weight[:, None]
    ground_bgr[rows, columns] = np.rint(mixed).astype(np.uint8)


class SoftEdge:
    """Blends a layer with soft edges over the ground, its weight rising from its edge inward.

    width_px: from the edge of the kept part (weight near 0) to where the layer is opaque. Weight
    is the distance to the edge over the width. Pixels outside of the mask, which show the layer's
    background, have none: there is no halo. The edges of the image are no edges of the object.
    Works on the box around the mask only.
    """

    def __init__(self, width_px: float) -> None:
        self._width_px = width_px

    def __call__(self, layer_bgr: BgrImage, shown: Mask | None, ground_bgr: BgrImage) -> None:
        """Write the soft-edged blend into `ground_bgr`; shown: kept and unhidden layer pixels.

        Where a nearer surface of the ground hides the layer, its edge fades as well.
        """
        if shown is None:
            np.copyto(ground_bgr, layer_bgr)
            return
        left, top, across, down = cv2.boundingRect(shown)
        if not across or not down:
            return
        rows, columns = slice(top, top + down), slice(left, left + across)
        weight = self._weights(shown, rows, columns)
        if has_cover(shown):
            weight = weight * (shown[rows, columns].astype(np.float32) / np.float32(255))
        part = ground_bgr[rows, columns]
        upper = layer_bgr[rows, columns].astype(np.float32)
        part[:] = np.rint(part + (upper - part) * weight[:, :, None]).astype(np.uint8)

    def _weights(self, shown: Mask, rows: slice, columns: slice) -> NDArray[np.float32]:
        """Return the soft edge's weights, 0 to 1 per pixel of the box around the shown pixels."""
        box = shown[rows, columns]
        height_px, width_px = shown.shape
        # A border of zeros where the box ends within the image; none where the image ends.
        framed = cv2.copyMakeBorder(box, 1, 1, 1, 1, cv2.BORDER_REPLICATE)
        if rows.start > 0:
            framed[0] = 0
        if rows.stop < height_px:
            framed[-1] = 0
        if columns.start > 0:
            framed[:, 0] = 0
        if columns.stop < width_px:
            framed[:, -1] = 0
        far = cv2.distanceTransform(framed, cv2.DIST_L2, cv2.DIST_MASK_5)[1:-1, 1:-1]
        weight: NDArray[np.float32] = np.minimum(far / np.float32(self._width_px + 1.0), 1.0)
        return weight
