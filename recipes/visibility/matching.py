"""Template matching of an expected object in a mixture all of whose pixels are changed. Pure."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.recipes.visibility.model import Mask
from wil_campaign.vehicles.readings import BgrImage

Gray = NDArray[np.float32]

_SEARCHED = 0.2
"""Largest searched offset, as a share of the image's width."""
_MARGIN = 4
"""Margin around an object that is matched with it, in pixels: its edges distinguish it."""
_ALIKE = 0.02
"""Correlations that differ by less count as equal: the nearest shift is taken."""


@dataclass(frozen=True, slots=True)
class ImageShift:
    """The shift at which an image matches best. correlation: -1 to 1. samples: offset in pixels.

    contrast: of the match, as a share of that of the expected image; 0 or more.
    """

    correlation: float
    samples: float
    contrast: float


def best_shift(
    real_bgr: BgrImage, mixed_bgr: BgrImage, expected_bgr: BgrImage, own: Mask
) -> ImageShift | None:
    """Return the shift at which a mixture matches the expected object; None without texture.

    own: where the object is expected. The part that both images share with the real one (the same
    room, a blend) is subtracted first, so that the object remains.
    """
    real = _gray(real_bgr)
    mixed, expected = _without(real, _gray(mixed_bgr)), _without(real, _gray(expected_bgr))
    part = _box(own)
    template = expected[part]
    if template.std() < 1.0:
        return None
    reach = max(1, round(_SEARCHED * own.shape[1]))
    padded = np.pad(mixed, reach)
    top, left = part[0].start, part[1].start
    high, wide = template.shape
    searched = padded[top : top + high + 2 * reach, left : left + wide + 2 * reach]
    correlation = cv2.matchTemplate(searched, template, cv2.TM_CCOEFF_NORMED)
    correlation[~np.isfinite(correlation)] = -1.0
    best = float(correlation.max())
    rows, columns = np.nonzero(correlation >= best - _ALIKE)
    offsets = np.hypot(rows - reach, columns - reach)
    nearest = int(offsets.argmin())
    row, column = int(rows[nearest]), int(columns[nearest])
    contrast = _slope(template, searched[row : row + high, column : column + wide])
    return ImageShift(best, float(offsets[nearest]), max(0.0, contrast))


def _slope(template: Gray, image: Gray) -> float:
    """Return the contrast of an image relative to a template: 0.5 for half of it."""
    centred = template - template.mean()
    return float((centred * (image - image.mean())).sum() / (centred * centred).sum())


def _gray(image: BgrImage) -> Gray:
    """Return an image in grey levels for matching, float32."""
    gray = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_BGR2GRAY)
    return np.asarray(gray, np.float32)


def _without(real: Gray, image: Gray) -> Gray:
    """Return the part of an image that is no linear function of the real one."""
    centred, mean = real - real.mean(), image - image.mean()
    power = float((centred * centred).sum())
    weight = float((centred * mean).sum()) / power if power > 0.0 else 0.0
    return np.asarray(mean - np.float32(weight) * centred, np.float32)


def _box(own: Mask) -> tuple[slice, slice]:
    """Return the box of an object to match in an image, with a margin."""
    rows, columns = np.flatnonzero(own.any(axis=1)), np.flatnonzero(own.any(axis=0))
    return (
        slice(max(0, int(rows[0]) - _MARGIN), int(rows[-1]) + 1 + _MARGIN),
        slice(max(0, int(columns[0]) - _MARGIN), int(columns[-1]) + 1 + _MARGIN),
    )
