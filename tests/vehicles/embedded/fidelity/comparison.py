"""Figures and series of a flight held against the firmware's."""

import csv
import gzip
import json
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.vehicles.embedded.fidelity.step_flight import Autopilot, Figures, Sample, Series

LIMIT = 0.15
_HERE = Path(__file__).parent
_OVERSHOOT = {"m": 0.15, "g": 5.0}
"""An overshoot, which may be near zero, is off by its distance over 0.15 m, or 5 degrees."""

Ranges = dict[str, dict[str, tuple[float, float]]]


class Row(NamedTuple):
    """A figure: of the firmware (least, most), of the embedded vehicle, and how far off it is."""

    segment: str
    name: str
    firmware: tuple[float, float]
    embedded: float | None
    off: float

    @property
    def beyond(self) -> bool:
        """Return whether the figure is beyond the limit."""
        return abs(self.off) > LIMIT


def load_figures(autopilot: Autopilot) -> Ranges:
    """Return the least and the most of each figure over four flights of the firmware."""
    ranges: Ranges = json.loads((_HERE / f"{autopilot}.json").read_text("utf-8"))
    return ranges


def load_series(autopilot: Autopilot) -> Series:
    """Return the series of one flight of the firmware."""
    flown: Series = {}
    with gzip.open(_HERE / f"{autopilot}.csv.gz", "rt", newline="") as file:
        for segment, *values in list(csv.reader(file))[1:]:
            flown.setdefault(segment, []).append(Sample(*map(float, values)))
    return flown


def compare(firmware: Ranges, embedded: Figures) -> list[Row]:
    """Return how far each figure is off the firmware's range."""
    rows = []
    for segment, figures in firmware.items():
        for name, (least, most) in figures.items():
            here = embedded.get(segment, {}).get(name)
            rows.append(Row(segment, name, (least, most), here, _off(name, here, least, most)))
    return rows


def _off(name: str, here: float | None, least: float, most: float) -> float:
    if here is None:
        return math.inf
    end = min(max(here, least), most)
    if name.startswith("overshoot"):
        return (here - end) / _OVERSHOOT[name[-1]] * LIMIT
    return here / end - 1.0


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
