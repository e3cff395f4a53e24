"""Detects a frozen sensor: its readings stay the same while the vehicle moves; pure."""

import math
from typing import NamedTuple

from vehicles.readings import (
    GpsReading,
    ImuReading,
    LidarPointsReading,
    LidarScanReading,
    MicrophoneReading,
    PoseReading,
    RangefinderReading,
    Reading,
)
from worlds.frames import Pose, Vec3, norm, rotate, subtract

_SAME = 10
"""Up to so many equal readings in succession may be chance, with a sensor of coarse steps."""
_MOVED_M = 0.5
_APPROACHED_M = 0.25
"""Along its beam a rangefinder measures every centimetre."""


class _EqualReadings(NamedTuple):
    """The first of a series of equal readings: numbers, place, time; times: their count."""

    numbers: tuple[object, ...]
    place: Vec3
    t_s: float
    times: int


class FrozenReadings:
    """Detects that a sensor repeats the same reading while its vehicle moves."""

    def __init__(self) -> None:
        self._since: _EqualReadings | None = None

    def take(self, reading: Reading, pose: Pose | None) -> str | None:
        """Return a message that the sensor is frozen; None when not. pose: of the vehicle."""
        numbers = _numbers(reading)
        if not numbers:
            self._since = None
        if not numbers or pose is None:
            return None
        place, since = pose.position_ned_m, self._since
        if since is None or since.numbers != numbers:
            self._since = _EqualReadings(numbers, place, reading.t_s, 1)
            return None
        self._since = since = since._replace(times=since.times + 1)
        moved = subtract(place, since.place)
        far, limit_m = norm(moved), _MOVED_M
        if isinstance(reading, LidarScanReading):
            far = math.hypot(moved[0], moved[1])  # Walls are equally far from any height.
        if isinstance(reading, RangefinderReading):
            # Level flight over flat ground has the same range: only motion along the beam counts.
            beam = rotate(pose.q_wxyz, rotate(reading.mount.q_wxyz, (1.0, 0.0, 0.0)))
            far = abs(sum(a * b for a, b in zip(moved, beam, strict=True)))
            limit_m = _APPROACHED_M
        if isinstance(reading, MicrophoneReading):
            far, limit_m = 1.0, 0.0
        if since.times < _SAME or far <= limit_m:
            return None
        return (
            f"its last {since.times} readings, since {since.t_s:.2f} s, are the same, and the "
            f"vehicle moved {norm(moved):.2f} m meanwhile: the sensor is frozen"
        )


def _numbers(reading: Reading) -> tuple[object, ...]:  # noqa: PLR0911 - a line for each type
    """Return a reading's measured values to compare; empty without a hit, or if not compared."""
    match reading:
        case RangefinderReading(range_m=range_m):
            return (range_m,) if math.isfinite(range_m) else ()
        case LidarScanReading(ranges_m=ranges_m):
            return (ranges_m.tobytes(),) if bool((ranges_m < math.inf).any()) else ()
        case LidarPointsReading(points_frd_m=points):
            return (points.tobytes(),)
        case GpsReading():
            return (reading.latitude_deg, reading.longitude_deg, reading.altitude_m)
        case ImuReading():
            return (*reading.specific_force_frd_m_s2, *reading.rates_frd_rad_s)
        case PoseReading(pose=pose):
            return (*pose.position_ned_m, *pose.q_wxyz)
        case MicrophoneReading(samples=samples):
            return (samples.tobytes(),) if bool(samples.any()) else ()
        case _:
            return ()
