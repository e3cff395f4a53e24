"""The series of a flight held against the firmware's."""

import csv
import gzip
import math
from pathlib import Path
from statistics import median

import numpy as np

from wil_campaign.plugins.step_response.segments import Series, StepSample

_HERE = Path(__file__).parent


def load_series(autopilot: str) -> Series:
    """Return the series of one flight of the firmware."""
    flown: Series = {}
    with gzip.open(_HERE / f"{autopilot}.csv.gz", "rt", newline="") as file:
        for segment, *values in list(csv.reader(file))[1:]:
            flown.setdefault(segment, []).append(StepSample(*map(float, values)))
    return flown


def load_flights() -> list[Series]:
    """Return ten flights of PX4, of that of `load_series` and nine more, five samples a second.

    Samples hold metres along the first heading, to its right, and down from the segment's start.
    """
    flights: dict[str, Series] = {}
    with gzip.open(_HERE / "px4-flights.csv.gz", "rt", newline="") as file:
        for flight, segment, *values in list(csv.reader(file))[1:]:
            t_s, along_m, right_m, down_m = map(float, values)
            sample = StepSample(t_s, along_m, right_m, down_m, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            flights.setdefault(flight, {}).setdefault(segment, []).append(sample)
    return list(flights.values())


def scatter(flights: list[Series]) -> dict[str, list[float]]:
    """Return of each segment how far (m, RMS) each flight is from the others: the medians."""
    apart = [
        [distances(flight, other) for other in flights if other is not flight] for flight in flights
    ]
    return {
        segment: [median(each[segment] for each in row) for row in apart] for segment in flights[0]
    }


def median_distances(flights: list[Series], embedded: Series) -> dict[str, float]:
    """Return of each segment the median of a flight's RMS distances (m) from the firmware's."""
    apart = [distances(flight, embedded) for flight in flights]
    return {segment: median(each[segment] for each in apart) for segment in flights[0]}


def pitch_distance_deg(firmware: Series, embedded: Series, segment: str, until_s: float) -> float:
    """Return the RMS difference of pitch (deg) in the first seconds of a segment."""
    one, other = (
        np.array(
            [(sample.t_s - flown[segment][0].t_s, sample.pitch_rad) for sample in flown[segment]]
        )
        for flown in (firmware, embedded)
    )
    times_s = np.arange(0.0, until_s, 0.02)
    gaps = np.interp(times_s, *one.T) - np.interp(times_s, *other.T)
    return math.degrees(math.sqrt(float(np.mean(np.square(gaps)))))


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
