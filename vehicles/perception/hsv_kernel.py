"""The compiled HSV test of an image's pixels against one range: exact, without a division.

OpenCV's conversion to HSV and a three-channel `inRange` cost 1.7 ms at 1280x720 on one core;
comparing hue, saturation and value multiplied out costs 0.5 ms, and has no rounding of the hue to
2 degrees. The numbers are whole and below 2^24, so single precision holds them exactly; Numba
would widen 32-bit integers to 64, which halves the speed.
"""

import numpy as np
from numpy.typing import NDArray

from wil_campaign.worlds.jit import jit_compiled

Plane = NDArray[np.uint8]
Limits = tuple[np.float32, np.float32, np.float32, np.float32, np.float32, np.float32]
"""Hue low and high in tenths of a degree, saturation low and high, value low and high (0-255)."""

_NONE, _FOUR, _SIX = np.float32(0), np.float32(4), np.float32(6)
_SIXTH, _FULL = np.float32(600), np.float32(255)


@jit_compiled
def mark_hsv_pixels(
    planes: tuple[Plane, Plane, Plane], limits: Limits, wraps: bool, any_hue: bool, out: Plane
) -> None:
    """Write 255 where a pixel lies within the HSV limits, else 0; planes: blue, green, red; flat.

    Hue after Smith, "Color Gamut Transform Pairs" (1978): with M = max, C = max - min, it is
    60 degrees times `sixth` / C, so `sixth * 600 >= low * C` compares tenths of a degree.
    """
    blue, green, red = planes
    hue_low, hue_high, pale, vivid, dark, bright = limits
    for i in range(out.shape[0]):
        b, g, r = np.float32(blue[i]), np.float32(green[i]), np.float32(red[i])
        value = max(b, g, r)
        chroma = value - min(b, g, r)
        sixth = (
            (g - b)
            if value == r
            else ((chroma + chroma + b - r) if value == g else (_FOUR * chroma + r - g))
        )
        sixth = sixth + _SIX * chroma if sixth < _NONE else sixth
        above = sixth * _SIXTH >= hue_low * chroma
        below = sixth * _SIXTH <= hue_high * chroma
        hue = ((above | below) if wraps else (above & below)) & (chroma > _NONE)
        inside = (
            (hue | any_hue)
            & (value >= dark)
            & (value <= bright)
            & (chroma * _FULL >= pale * value)
            & (chroma * _FULL <= vivid * value)
        )
        out[i] = np.uint8(255) if inside else np.uint8(0)
