"""Quantities of a reading that conditions can use, by sensor type. Pure."""

from collections.abc import Callable, Mapping
from operator import attrgetter
from types import MappingProxyType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.vehicles.readings import reading_types
from wil_campaign.vehicles.readings.numbers import number_fields
from wil_campaign.worlds.frames import norm

Values = float | NDArray[np.float32]
"""One number for the whole reading, or one per element."""

Quantity = Callable[[Any], Values | None]
"""Returns None where the reading does not have it."""


def _rms_pa(reading: Any) -> float:
    """Return the RMS sound pressure of a microphone reading: a quantity for conditions."""
    return float(np.sqrt(np.mean(np.square(reading.pressure_pa, dtype=np.float64))))


def _speed_of(velocity: Any) -> float | None:
    """Return the speed of a velocity as a quantity for conditions; None for None."""
    return None if velocity is None else norm(velocity)


def _numbers_of(kind: type) -> Mapping[str, Quantity]:
    """Return the numeric fields of a reading type as quantities."""
    return {name: attrgetter(name) for name in number_fields(kind)}


_OF_TYPES: Mapping[str, Mapping[str, Quantity]] = MappingProxyType(
    {
        "camera": {
            "brightness": lambda r: float(np.mean(cv2.mean(r.image_bgr)[:3])),
            "depth_m": lambda r: r.depth_m,
        },
        "depth": {"depth_m": lambda r: r.depth_m, "nearest_m": lambda r: float(r.depth_m.min())},
        "lidar": {
            "range_m": lambda r: r.ranges_m,
            "nearest_m": lambda r: float(r.ranges_m.min()),
        },
        "lidar_points": {
            "nearest_m": lambda r: (
                float(np.linalg.norm(r.points_frd_m, axis=1).min()) if len(r.points_frd_m) else None
            ),
        },
        "rangefinder": {"range_m": lambda r: r.range_m},
        "gps": {
            "fix_type": lambda r: float(r.fix_type),
            "satellites": lambda r: float(r.satellites),
            "horizontal_accuracy_m": lambda r: r.horizontal_accuracy_m,
            "vertical_accuracy_m": lambda r: r.vertical_accuracy_m,
            "altitude_m": lambda r: r.altitude_m,
            "speed_m_s": lambda r: _speed_of(r.velocity_ned_m_s),
        },
        "pose": {
            "up_m": lambda r: -r.pose.position_ned_m[2],
            "speed_m_s": lambda r: _speed_of(r.velocity_ned_m_s),
        },
        "imu": {
            "force_m_s2": lambda r: norm(r.specific_force_frd_m_s2),
            "rate_rad_s": lambda r: norm(r.rates_frd_rad_s),
        },
        "microphone": {"loudness_pa": _rms_pa},
    }
)


def quantities_of(kind: str) -> Mapping[str, Quantity]:
    """Return a sensor type's quantities by name; an array where a reading has many elements."""
    return _OF_TYPES.get(kind) or _numbers_of(reading_types()[kind])
