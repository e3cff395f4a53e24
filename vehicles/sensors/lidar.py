"""Lidars, 2-D and 3-D, and the rangefinder: beams cast into the scene, with noise."""

import math
from dataclasses import dataclass

import numpy as np

from wil_campaign.vehicles.readings import (
    LidarPointsReading,
    LidarScanReading,
    RangefinderReading,
    Source,
)
from wil_campaign.vehicles.sensors.beams import (
    RangeNoise,
    RayCaster,
    cone_directions,
    disturb,
    grid_directions,
    plane_directions,
)
from wil_campaign.vehicles.sensors.noise_sets import NoiseSets
from wil_campaign.vehicles.sensors.timing import Timing
from wil_campaign.vehicles.sensors.truth import Truth
from wil_campaign.worlds.frames import Pose

AT_BODY = Pose((0.0, 0.0, 0.0))
LOOKING_DOWN = Pose.of(0.0, 0.0, 0.0, pitch_rad=-math.pi / 2.0)


@dataclass(frozen=True, slots=True)
class ScanPattern:
    """The beams of a 2-D lidar: beam i looks at start_angle_rad + i * step_rad, rightwards.

    The default is a full turn of 400 beams (Slamtec RPLIDAR A2M8 data sheet rev. 2.5: 4000 to
    8000 samples per second at 10 Hz).
    """

    beams: int = 400
    start_angle_rad: float = -math.pi
    step_rad: float = 2.0 * math.pi / 400


@dataclass(frozen=True, slots=True)
class GridPattern:
    """The beams of a 3-D lidar: a full turn of columns, each of equally spaced rings.

    The default is the Velodyne VLP-16 (user manual 63-9243): 16 rings from -15 to +15 degrees,
    0.4 degrees between columns at 20 Hz.
    """

    columns: int = 900
    rings: int = 16
    lowest_rad: float = math.radians(-15.0)
    highest_rad: float = math.radians(15.0)


def silent(noise: RangeNoise) -> RangeNoise:
    """Return a lidar's noise settings without noise, with the same range limits."""
    return RangeNoise(noise.range_min_m, noise.range_max_m)


SCAN_NOISE = RangeNoise(0.15, 12.0, sigma_per_m=0.01)
"""RPLIDAR A2M8 data sheet rev. 2.5: 0.15 to 12 m, resolution below 1 % of the distance."""
POINTS_NOISE = RangeNoise(0.5, 100.0, sigma_m=0.03)
"""VLP-16 user manual: up to 100 m, typical accuracy 3 cm. Blind below 0.5 m: an assumption."""
RANGEFINDER_NOISE = RangeNoise(0.1, 12.0, sigma_m=0.05 / 3.0)
"""Benewake TFmini Plus data sheet: 0.1 to 12 m, 5 cm below 6 m, read as three deviations."""

SCAN_NOISES = NoiseSets(ideal=silent(SCAN_NOISE), datasheet=SCAN_NOISE)
POINTS_NOISES = NoiseSets(ideal=silent(POINTS_NOISE), datasheet=POINTS_NOISE)
RANGEFINDER_NOISES = NoiseSets(ideal=silent(RANGEFINDER_NOISE), datasheet=RANGEFINDER_NOISE)

SCAN_TIMING = Timing(rate_hz=10.0, latency_s=0.1)
POINTS_TIMING = Timing(rate_hz=20.0, latency_s=0.05)
RANGEFINDER_TIMING = Timing(rate_hz=50.0, latency_s=0.01)
"""Scans are delivered when their turn is over; the whole turn is cast at its middle."""


class LidarScanSensor:
    """A 2-D lidar sensor; keeps its count."""

    def __init__(
        self,
        *,
        source: Source,
        cast: RayCaster,
        pattern: ScanPattern | None = None,
        noise: RangeNoise | None = None,
        timing: Timing = SCAN_TIMING,
        mount: Pose = AT_BODY,
    ) -> None:
        self.timing = timing
        self._source = source
        self._cast = cast
        self._pattern = p = pattern or ScanPattern()
        self._noise = noise or silent(SCAN_NOISE)
        self._mount = mount
        self._directions = plane_directions(p.start_angle_rad, p.step_rad, p.beams)
        self._seq = 0

    def sample(self, truth: Truth, t_s: float, rng: np.random.Generator) -> LidarScanReading:
        """Return the lidar scan whose middle is at t_s."""
        hits = self._cast(truth.pose.compose(self._mount), self._directions, t_s)
        seen = disturb(hits, self._noise, rng)
        self._seq += 1
        return LidarScanReading(
            t_s=t_s,
            arrived_s=self.timing.arrival_s(t_s, rng),
            seq=self._seq - 1,
            source=self._source,
            ranges_m=seen.ranges_m,
            start_angle_rad=self._pattern.start_angle_rad,
            step_rad=self._pattern.step_rad,
            range_min_m=self._noise.range_min_m,
            range_max_m=self._noise.range_max_m,
            object_ids=seen.object_ids,
            mount=self._mount,
        )


class LidarPointsSensor:
    """A 3-D lidar sensor; keeps its count."""

    def __init__(
        self,
        *,
        source: Source,
        cast: RayCaster,
        pattern: GridPattern | None = None,
        noise: RangeNoise | None = None,
        timing: Timing = POINTS_TIMING,
        mount: Pose = AT_BODY,
    ) -> None:
        self.timing = timing
        self._source = source
        self._cast = cast
        self._noise = noise or silent(POINTS_NOISE)
        self._mount = mount
        p = pattern or GridPattern()
        azimuths = 2.0 * math.pi * np.arange(p.columns) / p.columns
        self._directions = grid_directions(
            azimuths, np.linspace(p.lowest_rad, p.highest_rad, p.rings)
        )
        self._directions_32 = self._directions.astype(np.float32)
        self._seq = 0

    def sample(self, truth: Truth, t_s: float, rng: np.random.Generator) -> LidarPointsReading:
        """Return the lidar's point cloud whose middle is at t_s."""
        hits = self._cast(truth.pose.compose(self._mount), self._directions, t_s)
        seen = disturb(hits, self._noise, rng)
        met = np.isfinite(seen.ranges_m)
        self._seq += 1
        return LidarPointsReading(
            t_s=t_s,
            arrived_s=self.timing.arrival_s(t_s, rng),
            seq=self._seq - 1,
            source=self._source,
            points_frd_m=self._directions_32[met] * seen.ranges_m[met, np.newaxis],
            object_ids=seen.object_ids[met],
            mount=self._mount,
        )


class RangefinderSensor:
    """A rangefinder (a lidar of one cone): reports the nearest hit; keeps its count.

    half_angle_rad: of the cone; TFmini Plus data sheet: 3.6 degrees from edge to edge.
    """

    def __init__(
        self,
        *,
        source: Source,
        cast: RayCaster,
        half_angle_rad: float = math.radians(1.8),
        noise: RangeNoise | None = None,
        timing: Timing = RANGEFINDER_TIMING,
        mount: Pose = LOOKING_DOWN,
    ) -> None:
        self.timing = timing
        self._source = source
        self._cast = cast
        self._noise = noise or silent(RANGEFINDER_NOISE)
        self._mount = mount
        self._directions = cone_directions(half_angle_rad, 8)
        self._seq = 0

    def sample(self, truth: Truth, t_s: float, rng: np.random.Generator) -> RangefinderReading:
        """Return the rangefinder's distance at t_s."""
        hits = self._cast(truth.pose.compose(self._mount), self._directions, t_s)
        nearest = float(hits.ranges_m.min())
        self._seq += 1
        return RangefinderReading(
            t_s=t_s,
            arrived_s=self.timing.arrival_s(t_s, rng),
            seq=self._seq - 1,
            source=self._source,
            range_m=self._reported_range(nearest, rng),
            range_min_m=self._noise.range_min_m,
            range_max_m=self._noise.range_max_m,
            mount=self._mount,
        )

    def _reported_range(self, range_m: float, rng: np.random.Generator) -> float:
        """Return a rangefinder's range with noise; inf beyond its limits."""
        noise = self._noise
        if math.isfinite(range_m):
            range_m += (noise.sigma_m + noise.sigma_per_m * range_m) * float(rng.standard_normal())
        if not noise.range_min_m <= range_m <= noise.range_max_m:
            return math.inf
        if noise.dropout > 0.0 and float(rng.random()) < noise.dropout:
            return math.inf
        return range_m
