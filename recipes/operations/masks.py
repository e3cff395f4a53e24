"""Masks: which elements of a reading are kept."""

import cv2
import numpy as np
from numpy.typing import NDArray

from recipes.working import AnyMasked, Masked, R, element_shape
from vehicles.perception.hsv import Mask

Bools = NDArray[np.bool_]

KEPT = 255


def both(mask: Mask, earlier: Mask | None) -> Mask:
    """Return the conjunction of two masks; writes into the first."""
    if earlier is not None:
        cv2.bitwise_and(mask, earlier.reshape(mask.shape), dst=mask)
    return mask


def narrowed(work: Masked[R], keep: Bools) -> Masked[R]:
    """Return the side with its mask narrowed by `keep`: bool, one per element."""
    mask = keep.astype(np.uint8)
    mask *= KEPT
    if work.mask is not None:
        mask &= work.mask
    return Masked(work.reading, mask)


def with_mask(work: AnyMasked) -> Bools:
    """Return the mask of a side: one bool per element, whether it is kept."""
    if work.mask is None:
        return np.ones(element_shape(work.reading), np.bool_)
    chosen: Bools = work.mask != 0
    return chosen


def is_kept(work: AnyMasked) -> bool:
    """Return whether the mask keeps a reading of one value."""
    return work.mask is None or bool(work.mask.any())
