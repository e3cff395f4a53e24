"""Detects a frozen sensor: its readings stay the same while the vehicle moves; pure."""

import math
from typing import NamedTuple

from wil_campaign.vehicles.readings import (
    CameraReading,
    DepthReading,
    GpsReading,
    ImuReading,
    LidarPointsReading,
    LidarScanReading,
    MicrophoneReading,
    PoseReading,
    RangefinderReading,
    Reading,
)
from wil_campaign.worlds.frames import Pose, Vec3, angle_between, norm, rotate, subtract

_SAME = 10
"""Up to so many equal readings in succession may be chance, with a sensor of coarse steps."""
_MOVED_M = 0.5
_APPROACHED_M = 0.25
"""Along its beam a rangefinder measures every centimetre."""
_TURNED_RAD = math.radians(20.0)
"""A camera that turns so far has another part of the world in a third of its image."""


class _EqualReadings(NamedTuple):
    """The first of a series of equal readings: numbers, pose, time; times: their count."""

    numbers: tuple[object, ...]
    pose: Pose
    t_s: float
    times: int


class FrozenReadings:
    """Detects that a sensor repeats the same reading while its vehicle moves."""

    def __init__(self) -> None:
        self._since: _EqualReadings | None = None

    def receive(self, reading: Reading, pose: Pose | None) -> str | None:
        """Return a message that the sensor is frozen; None when not. pose: of the vehicle."""
        numbers = _numbers(reading)
        if not numbers:
            self._since = None
        if not numbers or pose is None:
            return None
        since = self._since
        if since is None or since.numbers != numbers:
            self._since = _EqualReadings(numbers, pose, reading.t_s, 1)
            return None
        self._since = since = since._replace(times=since.times + 1)
        if since.times < _SAME or not _has_moved(reading, since.pose, pose):
            return None
        moved = f"moved {norm(subtract(pose.position_ned_m, since.pose.position_ned_m)):.2f} m"
        if isinstance(reading, CameraReading | DepthReading):
            turned_rad = angle_between(since.pose.q_wxyz, pose.q_wxyz)
            moved += f" and turned {math.degrees(turned_rad):.0f} deg"
        return (
            f"its last {since.times} readings, since {since.t_s:.2f} s, are the same, and the "
            f"vehicle {moved} meanwhile: the sensor is frozen"
        )


def _has_moved(reading: Reading, since: Pose, now: Pose) -> bool:
    """Return whether a vehicle moved so far that readings of this type cannot stay the same."""
    moved: Vec3 = subtract(now.position_ned_m, since.position_ned_m)
    match reading:
        case MicrophoneReading():
            return True
        case CameraReading() | DepthReading():
            turned_rad = angle_between(since.q_wxyz, now.q_wxyz)
            return norm(moved) > _MOVED_M or turned_rad > _TURNED_RAD
        case LidarScanReading():
            # Walls are equally far from any height.
            return math.hypot(moved[0], moved[1]) > _MOVED_M
        case RangefinderReading():
            # Level flight over flat ground has the same range: only motion along the beam counts.
            beam = rotate(now.q_wxyz, rotate(reading.mount.q_wxyz, (1.0, 0.0, 0.0)))
            along_m = abs(sum(a * b for a, b in zip(moved, beam, strict=True)))
            return along_m > _APPROACHED_M
        case _:
            return norm(moved) > _MOVED_M


def _numbers(reading: Reading) -> tuple[object, ...]:  # noqa: PLR0911 - a line for each type
    """Return a reading's measured values to compare; empty without a hit, or if not compared."""
    match reading:
        case CameraReading(image_bgr=image_bgr):
            # To compare bytes ends at the first that differs: cheaper than any digest.
            return (image_bgr.tobytes(),)
        case DepthReading(depth_m=depth_m):
            return (depth_m.tobytes(),) if bool((depth_m < math.inf).any()) else ()
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
