"""The difference between two readings of one sensor; pure."""

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from wil_campaign.vehicles.readings import CameraReading, Reading

JPEG_MEAN_LEVELS = 2.0
JPEG_FAR_LEVELS = 48
JPEG_FAR_SHARE = 0.005
"""Allowed JPEG loss of images mixed from JPEG images: mean difference in grey levels, and the
share of pixels that differ by more than JPEG_FAR_LEVELS. Measured on the gate's runs at quality 85:
means of up to 0.42, shares of up to 0.1 %, at the edges of isolated objects."""


@dataclass(frozen=True, slots=True)
class ReadingDifference:
    """The difference of two readings. share: of differing pixels or elements; worst: largest.

    what: as text. worst and mean are in the reading's own unit; grey levels for images.
    """

    what: str
    share: float = 1.0
    mean: float = math.inf
    worst: float = math.inf


def difference_of_readings(
    recorded: Reading, again: Reading, *, exact: bool
) -> ReadingDifference | None:
    """Return the difference of a replayed reading from the recorded one; None if equal.

    exact: the inputs were recorded losslessly; else images may differ by the loss of JPEG.
    """
    if type(recorded) is not type(again):
        return ReadingDifference(f"{type(again).__name__} instead of {type(recorded).__name__}")
    if isinstance(recorded, CameraReading) and isinstance(again, CameraReading) and not exact:
        return _beyond_jpeg(recorded, again)
    for field in fields(recorded):
        found = _of_values(getattr(recorded, field.name), getattr(again, field.name), field.name)
        if found is not None:
            return found
    return None


def _beyond_jpeg(recorded: CameraReading, again: CameraReading) -> ReadingDifference | None:
    """Return the difference of a JPEG-recorded image that its loss does not explain."""
    found = _of_values(recorded.image_bgr, again.image_bgr, "image_bgr")
    if found is None or not math.isfinite(found.mean):
        return found
    levels = _levels(recorded.image_bgr, again.image_bgr)
    far = float((levels.max(axis=2) > JPEG_FAR_LEVELS).mean())
    if found.mean <= JPEG_MEAN_LEVELS and far <= JPEG_FAR_SHARE:
        return None
    what = f"{far:.2%} of its pixels by more than {JPEG_FAR_LEVELS} levels, beyond the loss of JPEG"
    return ReadingDifference(what, far, found.mean, found.worst)


def _of_values(recorded: Any, again: Any, name: str) -> ReadingDifference | None:
    """Return the difference of two values of a reading's field; NaN equals NaN."""
    if isinstance(recorded, np.ndarray) and isinstance(again, np.ndarray):
        return _of_arrays(recorded, again, name)
    if recorded == again or (recorded != recorded and again != again):  # noqa: PLR0124 - NaN
        return None
    return ReadingDifference(f"{name} is {again!r} instead of {recorded!r}")


def _of_arrays(recorded: Any, again: Any, name: str) -> ReadingDifference | None:
    """Return the difference of two arrays of a reading's field; None if equal."""
    if recorded.shape != again.shape:
        return ReadingDifference(f"{name} is {again.shape} instead of {recorded.shape}")
    if np.array_equal(recorded, again, equal_nan=recorded.dtype.kind == "f"):
        return None
    levels = _levels(recorded, again)
    differing = levels > 0.0
    share = float(np.atleast_1d(differing.reshape(len(differing), -1)).mean())
    if differing.ndim == 3:
        share = float(differing.any(axis=2).mean())
    known = np.isfinite(levels)
    mean = float(levels[known].mean()) if known.any() else math.inf
    what = f"{share:.2%} of {name}, by up to {levels.max():.4g}"
    return ReadingDifference(what, share, mean, float(levels.max()))


def _levels(recorded: Any, again: Any) -> Any:
    """Return the absolute differences of two arrays; equal infinities and NaNs count 0."""
    with np.errstate(invalid="ignore"):
        apart = np.abs(recorded.astype(np.float32) - again.astype(np.float32))
    # Both infinite, or both NaN: equal.
    equal = (recorded == again) | (np.isnan(apart) & (np.isnan(recorded) == np.isnan(again)))
    return np.where(equal, np.float32(0.0), np.where(np.isnan(apart), np.inf, apart))
