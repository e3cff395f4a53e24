"""Masks of the kept elements of a reading."""

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.recipes.working import AnyMasked, Masked, R, element_shape
from wil_campaign.vehicles.readings import Mask

Bools = NDArray[np.bool_]

KEPT = 255


def intersect_masks(mask: Mask, earlier: Mask | None) -> Mask:
    """Return the intersection of two masks; writes into the first."""
    if earlier is not None:
        cv2.bitwise_and(mask, earlier.reshape(mask.shape), dst=mask)
    return mask


def narrow_mask(work: Masked[R], keep: Bools) -> Masked[R]:
    """Return the side with its mask narrowed by `keep`: bool, one per element."""
    mask = keep.astype(np.uint8)
    mask *= KEPT
    if work.mask is not None:
        mask &= work.mask
    return Masked(work.reading, mask)


def kept_elements(work: AnyMasked) -> Bools:
    """Return which elements of a side are kept: one bool per element."""
    if work.mask is None:
        return np.ones(element_shape(work.reading), np.bool_)
    kept: Bools = work.mask != 0
    return kept


def is_kept(work: AnyMasked) -> bool:
    """Return whether a reading of one value is kept."""
    return work.mask is None or bool(work.mask.any())
