"""The series of a flight held against the firmware's."""

import csv
import gzip
import math
from pathlib import Path

import numpy as np

from vehicles.autopilots.autopilot import AutopilotName
from vehicles.step_response.segments import Sample, Series

_HERE = Path(__file__).parent


def load_series(autopilot: AutopilotName) -> Series:
    """Return the series of one flight of the firmware."""
    flown: Series = {}
    with gzip.open(_HERE / f"{autopilot}.csv.gz", "rt", newline="") as file:
        for segment, *values in list(csv.reader(file))[1:]:
            flown.setdefault(segment, []).append(Sample(*map(float, values)))
    return flown


def distances(firmware: Series, embedded: Series) -> dict[str, float]:
    """Return the RMS distance (m) between the series of each segment.

    Both along the first heading and across it, from the segment's first sample, at equal times.
    """
    return {
        segment: _distance(_local(firmware, segment), _local(embedded, segment))
        for segment in firmware
        if segment in embedded
    }


def _local(flown: Series, segment: str) -> np.ndarray:
    """Return rows of s, along, right, down (m) from the segment's start."""
    yaw_rad = next(iter(flown.values()))[0].yaw_rad
    rows = np.array(flown[segment])[:, :4]
    rows -= rows[0]
    turn = np.array(
        [[math.cos(yaw_rad), -math.sin(yaw_rad)], [math.sin(yaw_rad), math.cos(yaw_rad)]]
    )
    rows[:, 1:3] = rows[:, 1:3] @ turn
    return rows


def _distance(one: np.ndarray, other: np.ndarray) -> float:
    times_s = one[one[:, 0] <= other[-1, 0], 0]
    gaps = [
        np.interp(times_s, one[:, 0], one[:, axis])
        - np.interp(times_s, other[:, 0], other[:, axis])
        for axis in (1, 2, 3)
    ]
    return float(np.sqrt(np.mean(np.sum(np.square(gaps), axis=0))))
