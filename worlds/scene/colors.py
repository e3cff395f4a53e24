"""Colours by name, as files give them: red, green, blue in 0..255 (sRGB)."""

import re

import numpy as np
from numpy.typing import NDArray

Rgb = tuple[int, int, int]

NAMED: dict[str, Rgb] = {
    "black": (20, 20, 22),
    "white": (240, 240, 240),
    "grey": (128, 128, 128),
    "gray": (128, 128, 128),
    "silver": (190, 190, 195),
    "red": (210, 30, 35),
    "orange": (255, 120, 0),
    "yellow": (245, 215, 30),
    "green": (40, 150, 60),
    "cyan": (40, 190, 200),
    "blue": (35, 80, 200),
    "navy": (30, 45, 95),
    "purple": (120, 50, 160),
    "magenta": (210, 45, 160),
    "pink": (240, 140, 175),
    "brown": (115, 75, 45),
    "beige": (205, 190, 160),
}

_HEX = re.compile(r"#[0-9a-fA-F]{6}")


def srgb_of_linear(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return linear intensities of 0 to 1 as sRGB (IEC 61966-2-1)."""
    low, high = 12.92 * linear, 1.055 * np.power(linear, 1.0 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, low, high)


def parse_color(value: str | list[int]) -> Rgb:
    """Return the colour of a name, of "#rrggbb" or of [red, green, blue].

    Raises ValueError when it is none of these.
    """
    if isinstance(value, list):
        return _from_list(value)
    if value in NAMED:
        return NAMED[value]
    if _HEX.fullmatch(value):
        return (int(value[1:3], 16), int(value[3:5], 16), int(value[5:7], 16))
    raise ValueError(f"unknown colour '{value}': a name, \"#rrggbb\" or [red, green, blue]")


def _from_list(value: list[int]) -> Rgb:
    """Return the colour of a list of three numbers. Raises ValueError outside 0 to 255."""
    if len(value) != 3 or not all(0 <= part <= 255 for part in value):
        raise ValueError(f"colour {value} is not three numbers from 0 to 255")
    return (value[0], value[1], value[2])
