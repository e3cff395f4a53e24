"""HSV colour ranges, and the mask of an image's pixels that lie in them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import cv2
import numpy as np

from wil_campaign.vehicles.perception.hsv_kernel import Limits, mark_hsv_pixels
from wil_campaign.vehicles.readings import BgrImage, Mask
from wil_campaign.worlds.jit import python_function

FULL_CIRCLE_DEG = (0.0, 360.0)
_FEW_PX = 64
"""Up to so many pixels are marked in Python, so that Numba need not be imported."""


@dataclass(frozen=True, slots=True)
class HsvRange:
    """A range of colours in HSV, both ends included.

    hue_deg: from the first clockwise to the second, in [0, 360]: (350, 10) goes through red.
    Grey has no hue: it is in only when hue_deg is the full circle. saturation and value: 0 to 1.
    Raises ValueError when a limit lies outside of that, or a pair is the wrong way round.
    """

    hue_deg: tuple[float, float] = FULL_CIRCLE_DEG
    saturation: tuple[float, float] = (0.0, 1.0)
    value: tuple[float, float] = (0.0, 1.0)

    def __post_init__(self) -> None:
        if not all(0.0 <= angle <= 360.0 for angle in self.hue_deg):
            raise ValueError(f"hue_deg {list(self.hue_deg)} is not within 0 to 360")
        for name, (low, high) in (("saturation", self.saturation), ("value", self.value)):
            if not 0.0 <= low <= high <= 1.0:
                raise ValueError(f"{name} [{low}, {high}] is not a range within 0 to 1")


def _hue(low: float, high: float, saturation: float = 0.35, value: float = 0.15) -> HsvRange:
    return HsvRange((low, high), (saturation, 1.0), (value, 1.0))


_GRAY = HsvRange(saturation=(0.0, 0.2), value=(0.2, 0.8))

NAMED_COLORS: Mapping[str, tuple[HsvRange, ...]] = MappingProxyType(
    {
        "red": (_hue(345, 12),),
        "orange": (_hue(12, 46, saturation=0.65),),
        "yellow": (_hue(46, 70),),
        "green": (_hue(70, 165),),
        "cyan": (_hue(165, 200),),
        "blue": (_hue(200, 260),),
        "purple": (_hue(260, 295),),
        "magenta": (_hue(295, 345),),
        "white": (HsvRange(saturation=(0.0, 0.2), value=(0.8, 1.0)),),
        "gray": (_GRAY,),
        "grey": (_GRAY,),
        "black": (HsvRange(value=(0.0, 0.2)),),
    }
)
"""Sectors of the hue circle around each colour's usual name; all of one colour's shades in light
and shadow keep its hue, so value reaches far down."""


@dataclass(slots=True)
class HsvMask:
    """Masks the pixels of an image that lie in any of some HSV ranges.

    The mask that `of` returns is this object's buffer: it is valid until the next call. Not
    thread-safe.
    """

    ranges: Sequence[HsvRange]
    _planes: list[Mask] = field(default_factory=list, init=False)
    _mask: Mask = field(default_factory=lambda: np.empty((0, 0), np.uint8), init=False)
    _more: Mask = field(default_factory=lambda: np.empty((0, 0), np.uint8), init=False)

    def of(self, image_bgr: BgrImage) -> Mask:
        """Return the HSV mask of a (height, width, 3) uint8 image."""
        shape = image_bgr.shape[:2]
        if self._mask.shape != shape:
            self._planes = [np.empty(shape, np.uint8) for _ in range(3)]
            self._mask, self._more = np.zeros(shape, np.uint8), np.empty(shape, np.uint8)
        cv2.split(image_bgr, self._planes)
        blue, green, red = (plane.reshape(-1) for plane in self._planes)
        mark = mark_hsv_pixels if self._mask.size > _FEW_PX else python_function(mark_hsv_pixels)
        for index, colors in enumerate(self.ranges):
            target = self._mask if index == 0 else self._more
            mark((blue, green, red), *_kernel_arguments(colors), target.reshape(-1))
            if index:
                cv2.bitwise_or(self._mask, self._more, dst=self._mask)
        return self._mask


def _kernel_arguments(colors: HsvRange) -> tuple[Limits, bool, bool]:
    # Red at 360 degrees is red at 0, which pixels have.
    hue_low, hue_high = (angle % 360.0 for angle in colors.hue_deg)
    pale, vivid, dark, bright = (
        np.float32(round(limit * 255)) for limit in (*colors.saturation, *colors.value)
    )
    low, high = np.float32(round(hue_low * 10)), np.float32(round(hue_high * 10))
    limits = (low, high, pale, vivid, dark, bright)
    return limits, hue_low > hue_high, colors.hue_deg == FULL_CIRCLE_DEG
