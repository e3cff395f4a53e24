"""Lidar scans: comparison of the beams of two, and resampling to the beams of another."""

import math
from dataclasses import replace

import numpy as np

from wil_campaign.recipes.working import Masked
from wil_campaign.vehicles.readings import LidarScanReading

_SAME_RAD = 1e-4
"""Beams that differ by less are the same: 1 mm at 10 m."""


def beams_mismatch(a: LidarScanReading, b: LidarScanReading) -> str:
    """Return that two scans have different beams, and the remedy; "" where they do not."""
    same = len(a.ranges_m) == len(b.ranges_m)
    if same and len(a.ranges_m):
        last = len(a.ranges_m) - 1
        ends = (
            a.start_angle_rad - b.start_angle_rad,
            a.start_angle_rad + last * a.step_rad - b.start_angle_rad - last * b.step_rad,
        )
        same = all(abs(math.remainder(end, math.tau)) < _SAME_RAD for end in ends)
    beams = " and ".join(
        f"{len(scan.ranges_m)} from {math.degrees(scan.start_angle_rad):g} deg by"
        f" {math.degrees(scan.step_rad):g}"
        for scan in (a, b)
    )
    return "" if same else f"beams are {beams}; add a resample_beams step"


def with_beams(
    work: Masked[LidarScanReading], *, count: int, start_angle_rad: float, step_rad: float
) -> Masked[LidarScanReading]:
    """Return the scan resampled to other beams: each takes the old beam nearest in angle.

    A new beam farther than half a step of the old ones (and half of the new) from any of them is
    outside of the scan: it has infinity, no object, and is not kept.
    """
    old = work.reading
    angles = start_angle_rad + np.arange(count) * step_rad
    turns = (angles - old.start_angle_rad) / old.step_rad
    around = abs(math.tau / old.step_rad)
    index = np.rint(turns)
    # A full turn wraps: take the turn in which the beam exists.
    wrapped = np.mod(index + 0.5, around) - 0.5
    nearest = np.rint(wrapped).astype(np.int64)
    last = len(old.ranges_m) - 1
    slack = 0.5 * max(1.0, abs(step_rad / old.step_rad)) + 1e-9
    clipped = np.clip(nearest, 0, last)
    apart = np.abs(np.mod(turns - clipped + around / 2, around) - around / 2)
    found = apart <= slack
    ranges_m = np.where(found, old.ranges_m[clipped], np.float32(np.inf)).astype(np.float32)
    ids = old.object_ids
    if ids is not None:
        ids = np.where(found, ids[clipped], 0).astype(np.uint8)
    mask = np.full(count, 255, np.uint8) if work.mask is None else work.mask[clipped]
    made = replace(
        old,
        ranges_m=ranges_m,
        object_ids=ids,
        start_angle_rad=start_angle_rad,
        step_rad=step_rad,
    )
    return Masked(made, np.where(found, mask, 0).astype(np.uint8))
