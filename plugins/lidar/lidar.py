"""The sensor type `lidar`: a 2-D lidar, whose beams are cast into the scene, with noise."""

import math
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from wil_campaign.plugins.lidar.beams import RangeNoise, disturb_hits, plane_directions
from wil_campaign.plugins.lidar.ranging import (
    LASER_SCAN,
    RangingOptions,
    ranging_limits_fault,
    without_range_noise,
)
from wil_campaign.plugins.lidar.scans import beams_mismatch
from wil_campaign.vehicles.readings import LidarScanReading, Source
from wil_campaign.vehicles.readings.faults import (
    ReadingFault,
    are_reading_numbers_finite,
    array_fault,
    distances_fault,
    object_ids_fault,
)
from wil_campaign.vehicles.readings.messages import (
    Json,
    base64_from_array,
    bytes_from_base64,
    number_from_json,
    numbers_to_json,
    pose_from_json,
    pose_to_json,
)
from wil_campaign.vehicles.readings.traits import Encoded, Parts, ReadingTraits
from wil_campaign.vehicles.sensors.beams import BeamFan, RayCaster
from wil_campaign.vehicles.sensors.noise_sets import NoiseSets
from wil_campaign.vehicles.sensors.sensor_spec import SensorSite, SensorSpec, TruthRate
from wil_campaign.vehicles.sensors.timing import Timing
from wil_campaign.vehicles.sensors.truth import Truth
from wil_campaign.worlds.frames import AT_ORIGIN, Pose


@dataclass(frozen=True, slots=True)
class ScanPattern:
    """The beams of a 2-D lidar: beam i looks at start_angle_rad + i * step_rad, rightwards.

    The default is a full turn of 400 beams (Slamtec RPLIDAR A2M8 data sheet rev. 2.5: 4000 to
    8000 samples per second at 10 Hz).
    """

    beams: int = 400
    start_angle_rad: float = -math.pi
    step_rad: float = 2.0 * math.pi / 400


SCAN_NOISE = RangeNoise(0.15, 12.0, sigma_per_m=0.01)
"""RPLIDAR A2M8 data sheet rev. 2.5: 0.15 to 12 m, resolution below 1 % of the distance."""
SCAN_NOISES = NoiseSets(ideal=without_range_noise(SCAN_NOISE), datasheet=SCAN_NOISE)
SCAN_TIMING = Timing(rate_hz=10.0, latency_s=0.1)
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
        mount: Pose = AT_ORIGIN,
    ) -> None:
        self.timing = timing
        self._source = source
        self._cast = cast
        self._pattern = p = pattern or ScanPattern()
        self._noise = noise or without_range_noise(SCAN_NOISE)
        self._mount = mount
        self._directions = plane_directions(p.start_angle_rad, p.step_rad, p.beams)
        self._seq = 0

    def sample(self, truth: Truth, t_s: float, rng: np.random.Generator) -> LidarScanReading:
        """Return the lidar scan whose middle is at t_s."""
        hits = self._cast(truth.pose.compose(self._mount), self._directions, t_s)
        seen = disturb_hits(hits, self._noise, rng)
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

    @property
    def fan(self) -> BeamFan:
        """Return the beams, each a column of its own."""
        p = self.pattern
        directions = plane_directions(p.start_angle_rad, p.step_rad, p.beams)
        return BeamFan(directions, np.arange(p.beams), p.beams)


def _model(options: LidarOptions, site: SensorSite) -> LidarScanSensor:
    return LidarScanSensor(
        source=site.side,
        cast=site.caster(),
        pattern=options.pattern,
        noise=options.within_reach(SCAN_NOISES.named(site.noise)),
        timing=site.timing(SCAN_TIMING, options.rate_hz),
        mount=site.mount,
    )


def _fault(reading: LidarScanReading) -> ReadingFault | None:
    """Check a lidar scan; return its fault or None."""
    ranges = reading.ranges_m
    fault = array_fault(ranges, (None,), np.float32, "scan")
    fault = fault or object_ids_fault(reading.object_ids, ranges.shape)
    if fault is not None:
        return fault
    if len(ranges) == 0:
        return ReadingFault("empty", "the scan has no beams")
    if not are_reading_numbers_finite((reading.start_angle_rad, reading.step_rad)):
        angles = f"start_angle_rad {reading.start_angle_rad}, step_rad {reading.step_rad}"
        return ReadingFault("not_finite", f"the beams' angles are not finite: {angles}")
    if reading.step_rad == 0.0 and len(ranges) > 1:
        return ReadingFault(
            "out_of_range", f"all of its {len(ranges)} beams look the same way: no step"
        )
    fault = ranging_limits_fault(reading.range_min_m, reading.range_max_m)
    return fault or distances_fault(ranges, "range")


def _encode(reading: LidarScanReading) -> Encoded:
    last = max(0, reading.ranges_m.size - 1)
    ids = reading.object_ids
    fields = {
        "pose": pose_to_json(reading.mount),
        "start_angle": reading.start_angle_rad,
        "end_angle": reading.start_angle_rad + last * reading.step_rad,
        "ranges": numbers_to_json(reading.ranges_m),
        "intensities": [],
        "wil": {
            "start_angle_rad": reading.start_angle_rad,
            "step_rad": reading.step_rad,
            "range_min_m": reading.range_min_m,
            "range_max_m": reading.range_max_m,
            "object_ids": None if ids is None else base64_from_array(ids),
        },
    }
    return fields, None


def _decode(document: Json, _: Parts) -> dict[str, Any]:
    wil = document["wil"]
    ids = wil["object_ids"]
    return {
        "ranges_m": np.array([number_from_json(one) for one in document["ranges"]], np.float32),
        "start_angle_rad": number_from_json(wil["start_angle_rad"]),
        "step_rad": number_from_json(wil["step_rad"]),
        "range_min_m": number_from_json(wil["range_min_m"]),
        "range_max_m": number_from_json(wil["range_max_m"]),
        "object_ids": None if ids is None else np.frombuffer(bytes_from_base64(ids), np.uint8),
        "mount": pose_from_json(document["pose"]),
    }


def _compared(reading: LidarScanReading) -> tuple[object, ...]:
    return (reading.ranges_m.tobytes(),) if bool((reading.ranges_m < math.inf).any()) else ()


def _has_moved(reading: Any, since: Pose, now: Pose) -> bool:
    """Return whether a lidar moved so far to a side: walls are equally far from any height."""
    del reading
    (north_m, east_m, _), (n_m, e_m, _) = now.position_ned_m, since.position_ned_m
    return math.hypot(north_m - n_m, east_m - e_m) > _MOVED_M


_MOVED_M = 0.5


def _blank(sensor: Any, side: Source) -> LidarScanReading:
    pattern = sensor.options.pattern
    return LidarScanReading(
        t_s=0.0,
        arrived_s=0.0,
        seq=0,
        source=side,
        ranges_m=np.full(pattern.beams, np.inf, np.float32),
        start_angle_rad=pattern.start_angle_rad,
        step_rad=pattern.step_rad,
        range_min_m=0.0,
        range_max_m=np.inf,
        sensor=sensor.name,
    )


_TRAITS = ReadingTraits(
    fault=_fault,
    schema=LASER_SCAN,
    encode=_encode,
    decode=_decode,
    compared=_compared,
    has_moved=_has_moved,
    blank=_blank,
    size=lambda r: f"{len(r.ranges_m)} beams",
    elements="ranges_m",
    overlaid=True,
    mismatch=beams_mismatch,
    ground_truth=("object_ids",),
    visibility="wil_campaign.plugins.lidar.visibility:SCANS",
    sketch="wil_campaign.plugins.lidar.scan_sketch:scans_svg",
    quantities={
        "range_m": lambda r: r.ranges_m,
        "nearest_m": lambda r: float(r.ranges_m.min()),
    },
)
LIDAR = SensorSpec(
    "lidar",
    LidarScanReading,
    LidarOptions,
    _model,
    traits=_TRAITS,
    mavlink="wil_campaign.plugins.lidar.obstacle_distance:SCANS",
)
