"""Lidars, 2-D and 3-D, and the rangefinder: beams cast into the scene, with noise."""

import math
from dataclasses import dataclass, replace
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from wil_campaign.foundation.files.documents import KeyFaultError
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
from wil_campaign.vehicles.sensors.sensor_spec import (
    MountedOptions,
    MountPart,
    SensorSite,
    SensorSpec,
    TruthRate,
)
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


Metres = Annotated[float, Field(ge=0, le=10_000)]


class RangingOptions(MountedOptions):
    """The keys of every ranging sensor; its range defaults to that of the profile's sensor.

    range_min_m: the least measured distance. range_max_m: the greatest measured distance.
    """

    range_min_m: Metres | None = None
    range_max_m: Annotated[float, Field(gt=0, le=10_000)] | None = None

    @model_validator(mode="after")
    def _require_order(self) -> Self:
        """Refuse a ranging sensor whose range_max_m is not above range_min_m."""
        low, high = self.range_min_m, self.range_max_m
        if low is not None and high is not None and low >= high:
            raise KeyFaultError("range_max_m", f"must be more than range_min_m, {low:g}")
        return self

    def within_reach(self, noise: RangeNoise) -> RangeNoise:
        """Return a ranging sensor's noise with the range limits that the campaign gives."""
        low_m, high_m = self.range_min_m, self.range_max_m
        return replace(
            noise,
            range_min_m=noise.range_min_m if low_m is None else low_m,
            range_max_m=noise.range_max_m if high_m is None else high_m,
        )


class LidarOptions(RangingOptions):
    """A 2-D lidar sensor: `beams` spread evenly over `fov_deg`, its middle forward.

    rate_hz: scans in a second. beams: their number in one scan. fov_deg: from the first beam to the
    last; 360 is a full turn.
    """

    rate_hz: TruthRate = 10.0
    beams: Annotated[int, Field(ge=1, le=100_000)] = 400
    fov_deg: Annotated[float, Field(gt=0, le=360)] = 360.0

    @property
    def pattern(self) -> ScanPattern:
        """Return the beams of the 2-D lidar sensor."""
        fov_rad, gaps = math.radians(self.fov_deg), self.beams - (self.fov_deg < 360.0)
        if self.beams == 1:
            return ScanPattern(1, 0.0, fov_rad)
        return ScanPattern(self.beams, -fov_rad / 2.0, fov_rad / max(1, gaps))


class LidarPointsOptions(RangingOptions):
    """A 3-D lidar sensor: a full turn of `columns`, each of `rings` between two elevations.

    rate_hz: turns in a second. columns: number of directions of one turn. rings: number of beams of
    each column, by elevation. lowest_deg: elevation of the lowest ring, positive upwards.
    highest_deg: elevation of the highest ring, positive upwards.
    """

    rate_hz: TruthRate = 20.0
    columns: Annotated[int, Field(ge=1, le=10_000)] = 900
    rings: Annotated[int, Field(ge=1, le=256)] = 16
    lowest_deg: Annotated[float, Field(ge=-90, le=90)] = -15.0
    highest_deg: Annotated[float, Field(ge=-90, le=90)] = 15.0

    @model_validator(mode="after")
    def _require_upwards(self) -> Self:
        """Refuse a 3-D lidar sensor whose highest_deg is below lowest_deg."""
        if self.highest_deg < self.lowest_deg:
            raise KeyFaultError("highest_deg", f"must be at least lowest_deg, {self.lowest_deg:g}")
        return self

    @property
    def pattern(self) -> GridPattern:
        """Return the beams of the 3-D lidar sensor."""
        low_rad, high_rad = math.radians(self.lowest_deg), math.radians(self.highest_deg)
        return GridPattern(self.columns, self.rings, low_rad, high_rad)


class RangefinderOptions(RangingOptions):
    """A rangefinder sensor: one beam, `beam_deg` wide; looks down unless a mount is given.

    rate_hz: measurements in a second. beam_deg: full width of the beam.
    """

    rate_hz: TruthRate = 50.0
    beam_deg: Annotated[float, Field(ge=0, le=90)] = 3.6
    mount: MountPart = MountPart(pitch_deg=-90.0)

    @property
    def half_angle_rad(self) -> float:
        """Return the half width of the rangefinder's beam."""
        return math.radians(self.beam_deg / 2.0)


def _scan_model(options: LidarOptions, site: SensorSite) -> LidarScanSensor:
    return LidarScanSensor(
        source=site.side,
        cast=site.caster(),
        pattern=options.pattern,
        noise=options.within_reach(SCAN_NOISES.named(site.noise)),
        timing=site.timing(SCAN_TIMING, options.rate_hz),
        mount=site.mount,
    )


def _points_model(options: LidarPointsOptions, site: SensorSite) -> LidarPointsSensor:
    return LidarPointsSensor(
        source=site.side,
        cast=site.caster(),
        pattern=options.pattern,
        noise=options.within_reach(POINTS_NOISES.named(site.noise)),
        timing=site.timing(POINTS_TIMING, options.rate_hz),
        mount=site.mount,
    )


def _rangefinder_model(options: RangefinderOptions, site: SensorSite) -> RangefinderSensor:
    return RangefinderSensor(
        source=site.side,
        cast=site.caster(),
        half_angle_rad=options.half_angle_rad,
        noise=options.within_reach(RANGEFINDER_NOISES.named(site.noise)),
        timing=site.timing(RANGEFINDER_TIMING, options.rate_hz),
        mount=site.mount,
    )


LIDAR = SensorSpec("lidar", LidarScanReading, LidarOptions, _scan_model)
LIDAR_POINTS = SensorSpec("lidar_points", LidarPointsReading, LidarPointsOptions, _points_model)
RANGEFINDER = SensorSpec("rangefinder", RangefinderReading, RangefinderOptions, _rangefinder_model)
