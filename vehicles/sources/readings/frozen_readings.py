"""Detects a sensor that shows nothing: its readings stay the same while the vehicle moves; pure."""

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
_EDGE_ROWS, _CLOCK_BLOCKS = 2, 12
"""A clock laid over a still changes blocks of its upper, or of its lower, rows: at most so many."""
_CONTRAST = 8.0
"""Between the quarters of the means; a camera that sees less of a scene may go on seeing it."""
_PASSED_M, _TURNED_RAD = 1.5, math.radians(20.0)
"""After so much way, or a turn, the means of a scene are others, however far away it is."""
_BLACK, _WHITE = 12, 250
"""A camera all of whose means are below the first, or above the second, is covered or dazzled."""
_NEAR_M, _NEAR_SHARE, _FAR_SHARE = 0.15, 0.1, 0.01
"""A depth camera that sees so much within the first, and no more beyond, is covered."""
_DEPTH_STEP = 8
"""Each so many-th row and column of a depth image are looked at."""
_BLANK_S = 1.0
"""For so long a camera may look into the sun, or out of a dark corner."""


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


class _Blank(NamedTuple):
    """The first of a series of images that are black, white, or next to the camera, all over."""

    word: str
    pose: Pose
    t_s: float


class FrozenReadings:
    """Detects that a sensor repeats the same reading while its vehicle moves."""

    def __init__(self) -> None:
        self._since: _EqualReadings | None = None
        self._still: _Still | None = None
        self._blank: _Blank | None = None

    def receive(self, reading: Reading, pose: Pose | None) -> str | None:
        """Return a message that the sensor is frozen; None when not. pose: of the vehicle."""
        equal = self._receive_equal(reading, pose)
        if equal is not None or pose is None:
            return equal
        if isinstance(reading, DepthReading):
            return self._receive_blank(reading, _depth_blank(reading), pose)
        if not isinstance(reading, CameraReading):
            return None
        means = cv2.resize(reading.image_bgr, _BLOCKS, interpolation=cv2.INTER_AREA)
        word = "black" if means.max() <= _BLACK else "white" if means.min() >= _WHITE else ""
        return self._receive_blank(reading, word, pose) or self._receive_still(
            reading, means.astype(np.int16), pose
        )

    def _receive_blank(
        self, image: CameraReading | DepthReading, word: str, pose: Pose
    ) -> str | None:
        """Return a message that a camera in the air has shown nothing for too long.

        word: what its image is all over; "" for one that shows something.
        """
        if self._blank is None or self._blank.word != word:
            self._blank = _Blank(word, pose, image.t_s) if word else None
        blank = self._blank
        if blank is None or image.t_s - blank.t_s < _BLANK_S:
            return None
        if not traits_of(type(image)).has_moved(image, blank.pose, pose):
            return None
        return (
            f"its images were {word} all over for {image.t_s - blank.t_s:.2f} s: the camera is "
            "covered, dazzled or broken"
        )

    def _receive_still(
        self, image: CameraReading, means: NDArray[np.int16], pose: Pose
    ) -> str | None:
        """Return a message that a camera's images are those of a still behind a video codec."""
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
            f"its last {still.times} images, in {image.t_s - still.t_s:.2f} s, show the same, and "
            f"the vehicle moved {passed_m:.2f} m and turned {math.degrees(turned_rad):.0f} deg "
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
            f"its last {since.times} readings, in {reading.t_s - since.t_s:.2f} s, are the same, "
            f"and the vehicle {moved} meanwhile: the sensor is frozen"
        )


def _depth_blank(image: DepthReading) -> str:
    depth_m = image.depth_m[::_DEPTH_STEP, ::_DEPTH_STEP]
    near, known = np.count_nonzero(depth_m <= _NEAR_M), np.count_nonzero(np.isfinite(depth_m))
    is_near = near >= _NEAR_SHARE * depth_m.size and known - near <= _FAR_SHARE * depth_m.size
    return f"within {_NEAR_M:g} m" if is_near else ""


def _has_contrast(means: NDArray[np.int16]) -> bool:
    low, high = np.percentile(means.mean(axis=2), (25, 75))
    return bool(high - low >= _CONTRAST)


def _is_still(first: NDArray[np.int16], now: NDArray[np.int16]) -> bool:
    apart = np.abs(now - first).max(axis=2)
    is_other = apart > _STILL_MOST
    if is_other.any():
        within = slice(_EDGE_ROWS, -_EDGE_ROWS)
        # What is between these rows has to show by itself that it stands still.
        if not _may_be_clock(is_other) or not _has_contrast(first[within]):
            return False
    rest = apart[~is_other]
    return bool(np.count_nonzero(rest <= _STILL_LEVELS) >= _STILL_SHARE * rest.size)


def _may_be_clock(is_other: NDArray[np.bool_]) -> bool:
    upper, lower = is_other[:_EDGE_ROWS], is_other[-_EDGE_ROWS:]
    most = max(np.count_nonzero(upper), np.count_nonzero(lower))
    return bool(most == np.count_nonzero(is_other) <= _CLOCK_BLOCKS)
