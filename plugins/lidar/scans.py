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
    if same:
        # Each beam: a full turn that ends where it begins has the ends of its mirror image.
        apart = a.angles_rad - b.angles_rad
        same = bool((np.abs(apart - np.rint(apart / math.tau) * math.tau) < _SAME_RAD).all())
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
    # A single beam may have no step.
    old_rad = old.step_rad or step_rad or math.tau
    around, last = abs(math.tau / old_rad), len(old.ranges_m) - 1
    # In steps from the middle of the old scan, the shorter way round.
    turns = (angles - old.start_angle_rad) / old_rad - last / 2
    turns = np.mod(turns + around / 2, around) - around / 2 + last / 2
    clipped = np.clip(np.rint(turns).astype(np.int64), 0, last)
    slack = 0.5 * max(1.0, abs(step_rad / old_rad)) + 1e-9
    found = np.abs(turns - clipped) <= slack
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
