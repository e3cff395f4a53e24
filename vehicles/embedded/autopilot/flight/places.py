"""The bounds of positions and parameters that a firmware accepts."""

import math

HIGHEST_M = 83_000.0
"""LOCATION_ALT_MAX_M of ArduPilot: the largest altitude that its integers can store."""
FARTHEST_M = 1e7
"""Local setpoints are bounded to this distance: half the way round the earth is 2e7."""
FASTEST_M_S = 1e4


def is_on_globe(latitude_deg: float, longitude_deg: float) -> bool:
    """Return whether a place's latitude and longitude are valid."""
    return abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0


def is_altitude(altitude_m: float) -> bool:
    """Return whether a place's altitude can be stored by a firmware."""
    return abs(altitude_m) <= HIGHEST_M


def bounded_value(value: float, most: float) -> float:
    """Return a finite value of a place within bounds. Raises ValueError if not finite."""
    if not math.isfinite(value):
        raise ValueError(f"{value} is not finite")
    return max(-most, min(most, value))


def int32_of_float(value: float) -> int:
    """Return a float field of a place as int32: cut and bounded, 0 where it is NaN."""
    if math.isnan(value):
        return 0
    return int(max(-(2.0**31), min(2.0**31 - 1.0, value)))
