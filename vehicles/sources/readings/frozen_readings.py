"""Detects a frozen sensor: its readings stay the same while the vehicle moves; pure."""

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.vehicles.readings import CameraReading, DepthReading, Reading
from wil_campaign.vehicles.readings.kinds import traits_of
from wil_campaign.worlds.frames import Pose, angle_between, norm, subtract

_SAME = 10
"""Up to so many equal readings in succession may be chance, with a sensor of coarse steps."""
_BLOCKS = (16, 12)
"""Columns and rows of an image's mean colours: a codec changes pixels of a still, not these."""
_STILL_LEVELS, _STILL_MOST, _STILL_SHARE = 1, 3, 0.95
"""Most means of a still stay within the first, and all within the second (H.264, 0.15 to 1 Mbit/s,
with a new key image)."""
_CONTRAST = 8.0
"""Between the quarters of the means; a camera that sees less of a scene may go on seeing it."""
_PASSED_M, _TURNED_RAD = 1.5, math.radians(20.0)
"""After so much way, or a turn, the means of a scene are others, however far away it is."""


class _EqualReadings(NamedTuple):
    """The first of a series of equal readings: numbers, pose, time; times: their count."""

    numbers: tuple[object, ...]
    pose: Pose
    t_s: float
    times: int


class _Still(NamedTuple):
    """The first of a series of images with the same means, as far as a codec keeps them."""

    means: NDArray[np.int16]
    pose: Pose
    t_s: float
    times: int


class FrozenReadings:
    """Detects that a sensor repeats the same reading while its vehicle moves."""

    def __init__(self) -> None:
        self._since: _EqualReadings | None = None
        self._still: _Still | None = None

    def receive(self, reading: Reading, pose: Pose | None) -> str | None:
        """Return a message that the sensor is frozen; None when not. pose: of the vehicle."""
        equal = self._receive_equal(reading, pose)
        if equal is not None or not isinstance(reading, CameraReading) or pose is None:
            return equal
        return self._receive_still(reading, pose)

    def _receive_still(self, image: CameraReading, pose: Pose) -> str | None:
        """Return a message that a camera's images are those of a still behind a video codec."""
        means = cv2.resize(image.image_bgr, _BLOCKS, interpolation=cv2.INTER_AREA).astype(np.int16)
        still = self._still
        if still is None or not _is_still(still.means, means):
            self._still = _Still(means, pose, image.t_s, 1) if _has_contrast(means) else None
            return None
        self._still = still = still._replace(times=still.times + 1)
        passed_m = norm(subtract(pose.position_ned_m, still.pose.position_ned_m))
        turned_rad = angle_between(still.pose.q_wxyz, pose.q_wxyz)
        if still.times < _SAME or (passed_m <= _PASSED_M and turned_rad <= _TURNED_RAD):
            return None
        return (
            f"its last {still.times} images, since {still.t_s:.2f} s, show the same, and the "
            f"vehicle moved {passed_m:.2f} m and turned {math.degrees(turned_rad):.0f} deg "
            "meanwhile: the sensor is frozen"
        )

    def _receive_equal(self, reading: Reading, pose: Pose | None) -> str | None:
        traits = traits_of(type(reading))
        numbers = traits.compared(reading)
        if not numbers:
            self._since = None
        if not numbers or pose is None:
            return None
        since = self._since
        if since is None or since.numbers != numbers:
            self._since = _EqualReadings(numbers, pose, reading.t_s, 1)
            return None
        self._since = since = since._replace(times=since.times + 1)
        if since.times < _SAME or not traits.has_moved(reading, since.pose, pose):
            return None
        moved = f"moved {norm(subtract(pose.position_ned_m, since.pose.position_ned_m)):.2f} m"
        if isinstance(reading, CameraReading | DepthReading):
            turned_rad = angle_between(since.pose.q_wxyz, pose.q_wxyz)
            moved += f" and turned {math.degrees(turned_rad):.0f} deg"
        return (
            f"its last {since.times} readings, since {since.t_s:.2f} s, are the same, and the "
            f"vehicle {moved} meanwhile: the sensor is frozen"
        )


def _has_contrast(means: NDArray[np.int16]) -> bool:
    low, high = np.percentile(means.mean(axis=2), (25, 75))
    return bool(high - low >= _CONTRAST)


def _is_still(first: NDArray[np.int16], now: NDArray[np.int16]) -> bool:
    apart = np.abs(now - first)
    same = np.count_nonzero(apart <= _STILL_LEVELS)
    return int(apart.max()) <= _STILL_MOST and same >= _STILL_SHARE * apart.size
