"""Visibility of objects in an image of object ids, compared with geometry. Pure."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from wil_campaign.recipes.visibility.images import ImagePair, compare_outlines
from wil_campaign.recipes.visibility.model import (
    ExpectedImage,
    FrameVisibility,
    Ids,
    Mask,
    VirtualObjects,
)


def compare_ids(
    *,
    t_s: float,
    shown: Ids,
    expected: Ids,
    names: Mapping[int, str],
    limits_px: Mapping[int, float],
    px_per_sample: int,
) -> FrameVisibility:
    """Return the visibility of objects in an image of ids: each as white on black.

    shown, expected: (height, width). names: of the objects by id. limits_px: of each one's
    offset, in pixels of the full image; one sample is added.
    """
    found = []
    for object_id, name in names.items():
        here, there = shown == object_id, expected == object_id
        ids = np.where(there, expected, np.uint8(0))
        pair = ImagePair(
            t_s=t_s,
            real_bgr=np.zeros((*shown.shape, 3), np.uint8),
            mixed_bgr=_white(here),
            expected=ExpectedImage(ids, _white(there), None, px_per_sample),
            virtual=VirtualObjects({object_id: name}),
            limit_px=limits_px[object_id],
            is_like=True,
        )
        found.append(compare_outlines(pair, here, ids))
    return FrameVisibility(
        t_s,
        tuple(visibility for each in found for visibility in each.objects),
        max((each.changed for each in found), default=0.0),
        max((each.elsewhere for each in found), default=0.0),
        any(each.is_unexpected for each in found),
    )


def _white(mask: Mask) -> NDArray[np.uint8]:
    return np.repeat(mask[:, :, np.newaxis].astype(np.uint8) * np.uint8(255), 3, axis=2)
