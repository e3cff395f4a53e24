"""Beams of ranging sensors: their directions, and the noise of their hits."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wil_campaign.vehicles.sensors.beams import Directions, RayHits


@dataclass(frozen=True, slots=True)
class RangeNoise:
    """The noise that a ranging sensor's beams add, and their range limits.

    Standard deviation of a range: sigma_m + sigma_per_m * range. dropout: fraction of beams without
    a return. outlier: fraction with a return between the sensor and the hit (dust, a rotor blade).
    """

    range_min_m: float
    range_max_m: float
    sigma_m: float = 0.0
    sigma_per_m: float = 0.0
    dropout: float = 0.0
    outlier: float = 0.0


def disturb_hits(hits: RayHits, noise: RangeNoise, rng: np.random.Generator) -> RayHits:
    """Return the beams' hits with noise; out of range is inf, with object id 0."""
    ranges = hits.ranges_m.astype(np.float32)
    if noise.sigma_m > 0.0 or noise.sigma_per_m > 0.0:
        met = np.isfinite(ranges)
        sigma = noise.sigma_m + noise.sigma_per_m * ranges[met]
        # A draw for every beam: one beam's hit must not shift the noise of the others.
        ranges[met] += sigma * rng.standard_normal(len(ranges), dtype=np.float32)[met]
    if noise.outlier > 0.0:
        chance = rng.random((2, len(ranges)), dtype=np.float32)
        hit = (chance[0] < noise.outlier) & np.isfinite(ranges)
        near = np.float32(noise.range_min_m)
        ranges[hit] = near + chance[1][hit] * (ranges[hit] - near)
    lost = (ranges < noise.range_min_m) | (ranges > noise.range_max_m)
    if noise.dropout > 0.0:
        lost |= rng.random(len(ranges), dtype=np.float32) < noise.dropout
    ranges[lost] = np.inf
    return RayHits(ranges, np.where(lost, np.uint8(0), hits.object_ids))


def plane_directions(start_angle_rad: float, step_rad: float, beams: int) -> Directions:
    """Return (beams, 3) unit vectors of beams in the forward-right plane, rightwards."""
    angles = start_angle_rad + step_rad * np.arange(beams)
    return np.stack((np.cos(angles), np.sin(angles), np.zeros(beams)), axis=1)


def grid_directions(
    azimuths_rad: NDArray[np.float64], elevations_rad: NDArray[np.float64]
) -> Directions:
    """Return (azimuths * elevations, 3) unit vectors of beams, grouped by azimuth.

    Azimuth from forward to the right, elevation upwards.
    """
    azimuth, elevation = np.meshgrid(azimuths_rad, elevations_rad, indexing="ij")
    level = np.cos(elevation)
    directions = (level * np.cos(azimuth), level * np.sin(azimuth), -np.sin(elevation))
    return np.stack(directions, axis=-1).reshape(-1, 3)


def cone_directions(half_angle_rad: float, ring_beams: int) -> Directions:
    """Return (1 + ring_beams, 3) unit vectors of beams: forward, and a ring round it."""
    around = 2.0 * math.pi * np.arange(ring_beams) / max(1, ring_beams)
    radius = math.sin(half_angle_rad)
    ring = np.stack(
        (
            np.full(ring_beams, math.cos(half_angle_rad)),
            radius * np.cos(around),
            radius * np.sin(around),
        ),
        axis=1,
    )
    return np.concatenate((np.array([[1.0, 0.0, 0.0]]), ring))
