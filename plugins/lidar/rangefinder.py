"""The sensor type `rangefinder`: the distance along one beam, which has some width."""

import math
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from wil_campaign.plugins.lidar.beams import RangeNoise, cone_directions
from wil_campaign.plugins.lidar.ranging import (
    LASER_SCAN,
    RangingOptions,
    ranging_limits_fault,
    without_range_noise,
)
from wil_campaign.vehicles.readings import RangefinderReading, Source
from wil_campaign.vehicles.readings.faults import ReadingFault
from wil_campaign.vehicles.readings.messages import (
    Json,
    number_from_json,
    pose_from_json,
    pose_to_json,
)
from wil_campaign.vehicles.readings.traits import Encoded, Parts, ReadingTraits
from wil_campaign.vehicles.sensors.beams import RayCaster
from wil_campaign.vehicles.sensors.noise_sets import NoiseSets
from wil_campaign.vehicles.sensors.sensor_spec import (
    MountPart,
    SensorSite,
    SensorSpec,
    TruthRate,
)
from wil_campaign.vehicles.sensors.timing import Timing
from wil_campaign.vehicles.sensors.truth import Truth
from wil_campaign.worlds.frames import Pose, rotate, subtract

LOOKING_DOWN = Pose.of(0.0, 0.0, 0.0, pitch_rad=-math.pi / 2.0)
RANGEFINDER_NOISE = RangeNoise(0.1, 12.0, sigma_m=0.05 / 3.0)
"""Benewake TFmini Plus data sheet: 0.1 to 12 m, 5 cm below 6 m, read as three deviations."""
RANGEFINDER_NOISES = NoiseSets(
    ideal=without_range_noise(RANGEFINDER_NOISE), datasheet=RANGEFINDER_NOISE
)
RANGEFINDER_TIMING = Timing(rate_hz=50.0, latency_s=0.01)
_APPROACHED_M = 0.25
"""Along its beam a rangefinder measures every centimetre."""


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
        self._noise = noise or without_range_noise(RANGEFINDER_NOISE)
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


def _model(options: RangefinderOptions, site: SensorSite) -> RangefinderSensor:
    return RangefinderSensor(
        source=site.side,
        cast=site.caster(),
        half_angle_rad=options.half_angle_rad,
        noise=options.within_reach(RANGEFINDER_NOISES.named(site.noise)),
        timing=site.timing(RANGEFINDER_TIMING, options.rate_hz),
        mount=site.mount,
    )


def _fault(reading: RangefinderReading) -> ReadingFault | None:
    """Check a rangefinder reading; return its fault or None."""
    if math.isnan(reading.range_m):
        return ReadingFault("not_finite", "the range is not a number")
    if reading.range_m < 0.0:
        return ReadingFault("negative", f"the range is {reading.range_m} m")
    return ranging_limits_fault(reading.range_min_m, reading.range_max_m)


def _encode(reading: RangefinderReading) -> Encoded:
    fields = {
        "pose": pose_to_json(reading.mount),
        "start_angle": 0.0,
        "end_angle": 0.0,
        "ranges": [reading.range_m],
        "intensities": [],
        "wil": {"range_min_m": reading.range_min_m, "range_max_m": reading.range_max_m},
    }
    return fields, None


def _decode(document: Json, _: Parts) -> dict[str, Any]:
    wil = document["wil"]
    return {
        "range_m": number_from_json(document["ranges"][0]),
        "range_min_m": number_from_json(wil["range_min_m"]),
        "range_max_m": number_from_json(wil["range_max_m"]),
        "mount": pose_from_json(document["pose"]),
    }


def _has_moved(reading: RangefinderReading, since: Pose, now: Pose) -> bool:
    """Return whether a rangefinder moved along its beam.

    Level flight over flat ground has the same range.
    """
    beam = rotate(now.q_wxyz, rotate(reading.mount.q_wxyz, (1.0, 0.0, 0.0)))
    moved = subtract(now.position_ned_m, since.position_ned_m)
    return abs(sum(a * b for a, b in zip(moved, beam, strict=True))) > _APPROACHED_M


_TRAITS = ReadingTraits(
    fault=_fault,
    schema=LASER_SCAN,
    encode=_encode,
    decode=_decode,
    compared=lambda r: (r.range_m,) if math.isfinite(r.range_m) else (),
    has_moved=_has_moved,
    overlaid=True,
    visibility="wil_campaign.plugins.lidar.visibility:BEAMS",
    quantities={"range_m": lambda r: r.range_m},
)
RANGEFINDER = SensorSpec(
    "rangefinder",
    RangefinderReading,
    RangefinderOptions,
    _model,
    traits=_TRAITS,
    mavlink="wil_campaign.plugins.lidar.distance_sensor:BEAMS",
)
