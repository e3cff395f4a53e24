"""Checks the readings of a vehicle at rest for wrong units and axes, before arming; pure.

At rest the right values are known closely, and a wrong unit is a factor of nine at the least (g
for m/s2), a wrong axis a quarter of a turn.
"""

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from wil_campaign.vehicles.readings import (
    DepthReading,
    GpsReading,
    ImuReading,
    PoseReading,
    Reading,
)
from wil_campaign.worlds.frames import Pose, angle_between, norm, quat_conjugate, rotate, subtract
from wil_campaign.worlds.geodesy import LocalFrame

_G_M_S2 = 9.80665
_G_FACTOR = 2.0
"""An accelerometer at rest measures gravity within a few per cent."""
_ASIDE_RAD = math.radians(45.0)
_STILL_RAD_S = 0.35
"""20 deg/s: a gyroscope at rest reports less; one in deg/s for rad/s exceeds it by its noise."""
_ORIGIN_M = 10.0
_DEVIATIONS = 5.0
_HEIGHT_M = 1000.0
"""Height error of a fix that is let pass: worlds' altitudes are read off maps and geoids."""
_DEPTHS_M = (0.02, 100.0)
"""Of a depth camera: from nearer than any measures to farther than any; millimetres are beyond."""
_POSE_M = 3.0
"""Two sources of a pose differ by less: an estimate at rest drifts by a metre."""


def rest_fault(reading: Reading, *, pose: Pose, frame: LocalFrame) -> str | None:
    """Return what is wrong with a reading of a vehicle at rest, in words; None for nothing.

    pose: of the vehicle in the world, from the source that judges it. frame: of the world on earth.
    """
    check = _CHECKS.get(type(reading))
    return None if check is None else check(reading, pose, frame)


def _imu(reading: ImuReading, pose: Pose, _: LocalFrame) -> str | None:
    force = reading.specific_force_frd_m_s2
    size = norm(force)
    if not _G_M_S2 / _G_FACTOR < size < _G_M_S2 * _G_FACTOR:
        return (
            f"its specific force at rest is {size:.4g}, not {_G_M_S2:.1f} m/s2: its unit is wrong"
        )
    expected = rotate(quat_conjugate(pose.q_wxyz), (0.0, 0.0, -_G_M_S2))
    cos = sum(a * b for a, b in zip(force, expected, strict=True)) / (size * _G_M_S2)
    if cos < math.cos(_ASIDE_RAD):
        parts = ", ".join(f"{part:.2f}" for part in force)
        return (
            f"its specific force at rest is ({parts}), not about (0, 0, -9.81) m/s2: its axes are "
            "not forward, right, down"
        )
    rate = norm(reading.rates_frd_rad_s)
    if rate > _STILL_RAD_S:
        return f"its rate at rest is {rate:.3g} rad/s: its unit is wrong, or the vehicle moves"
    return None


def _gps(reading: GpsReading, pose: Pose, frame: LocalFrame) -> str | None:
    place = frame.to_ned(reading.latitude_deg, reading.longitude_deg, reading.altitude_m)
    north_m, east_m, down_m = subtract(place, pose.position_ned_m)
    apart_m = math.hypot(north_m, east_m)
    limit_m = _ORIGIN_M + _DEVIATIONS * reading.horizontal_accuracy_m
    if apart_m <= limit_m and abs(down_m) <= _HEIGHT_M:
        return None
    return (
        f"its fix ({reading.latitude_deg:.6f}, {reading.longitude_deg:.6f}, "
        f"{reading.altitude_m:.0f} m) is {apart_m:.4g} m beside and {abs(down_m):.4g} m above or "
        "below the vehicle's place in the world: give the world the latitude, longitude and "
        "altitude of this place, or correct the unit"
    )


def _pose(reading: PoseReading, pose: Pose, _: LocalFrame) -> str | None:
    apart_m = norm(subtract(reading.pose.position_ned_m, pose.position_ned_m))
    if apart_m > _POSE_M:
        return (
            f"its position is {apart_m:.4g} m from the vehicle's place: its unit or frame is wrong"
        )
    turned_rad = angle_between(reading.pose.q_wxyz, pose.q_wxyz)
    if turned_rad > _ASIDE_RAD:
        return f"its attitude is {math.degrees(turned_rad):.0f} degrees off: its axes are wrong"
    return None


def _depth(reading: DepthReading, _: Pose, __: LocalFrame) -> str | None:
    seen = reading.depth_m[np.isfinite(reading.depth_m)]
    middle_m = float(np.median(seen)) if seen.size else 1.0
    least_m, most_m = _DEPTHS_M
    if least_m <= middle_m <= most_m:
        return None
    return (
        f"half of its distances are {'below' if middle_m < least_m else 'above'} {middle_m:.4g} m: "
        "its unit is wrong (`depth_m` is in metres, and infinity where nothing came back)"
    )


_CHECKS: Mapping[type, Callable[[Any, Pose, LocalFrame], str | None]] = MappingProxyType(
    {DepthReading: _depth, ImuReading: _imu, GpsReading: _gps, PoseReading: _pose}
)
