"""The sensor type `lidar_points`: a 3-D lidar, whose beams are cast into the scene."""

import math
from dataclasses import dataclass
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from wil_campaign.foundation.files.documents import KeyFaultError
from wil_campaign.plugins.lidar.beams import RangeNoise, disturb_hits, grid_directions
from wil_campaign.plugins.lidar.ranging import RangingOptions, without_range_noise
from wil_campaign.vehicles.readings import LidarPointsReading, Source
from wil_campaign.vehicles.readings.faults import ReadingFault, array_fault, object_ids_fault
from wil_campaign.vehicles.readings.messages import (
    BASE64,
    FLOAT32,
    INTEGER,
    POSE_SCHEMA,
    STRING,
    UINT8,
    Json,
    bytes_from_base64,
    pose_from_json,
    pose_to_json,
    schema_of_array,
    schema_of_object,
    stamped_message_schema,
)
from wil_campaign.vehicles.readings.traits import Encoded, Parts, ReadingTraits
from wil_campaign.vehicles.sensors.beams import BeamFan, RayCaster
from wil_campaign.vehicles.sensors.noise_sets import NoiseSets
from wil_campaign.vehicles.sensors.sensor_spec import SensorSite, SensorSpec, TruthRate
from wil_campaign.vehicles.sensors.timing import Timing
from wil_campaign.vehicles.sensors.truth import Truth
from wil_campaign.worlds.frames import AT_ORIGIN, Pose
from wil_campaign.worlds.geodesy import LocalFrame


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


POINTS_NOISE = RangeNoise(0.5, 100.0, sigma_m=0.03)
"""VLP-16 user manual: up to 100 m, typical accuracy 3 cm. Blind below 0.5 m: an assumption."""
_FARTHEST_M = 300.0
"""Of half of the points: no lidar on a drone measures as far."""
POINTS_NOISES = NoiseSets(ideal=without_range_noise(POINTS_NOISE), datasheet=POINTS_NOISE)
POINTS_TIMING = Timing(rate_hz=20.0, latency_s=0.05)
"""Points are delivered when their turn is over; the whole turn is cast at its middle."""


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
        mount: Pose = AT_ORIGIN,
    ) -> None:
        self.timing = timing
        self._source = source
        self._cast = cast
        self._noise = noise or without_range_noise(POINTS_NOISE)
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
        seen = disturb_hits(hits, self._noise, rng)
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

    @property
    def fan(self) -> BeamFan:
        """Return the beams of a turn that begins astern."""
        p = self.pattern
        turn_rad = 2.0 * math.pi * np.arange(p.columns) / p.columns - math.pi
        rings_rad = np.linspace(p.lowest_rad, p.highest_rad, p.rings)
        columns = np.repeat(np.arange(p.columns), p.rings)
        return BeamFan(grid_directions(turn_rad, rings_rad), columns, p.columns)


def _model(options: LidarPointsOptions, site: SensorSite) -> LidarPointsSensor:
    return LidarPointsSensor(
        source=site.side,
        cast=site.caster(),
        pattern=options.pattern,
        noise=options.within_reach(POINTS_NOISES.named(site.noise)),
        timing=site.timing(POINTS_TIMING, options.rate_hz),
        mount=site.mount,
    )


def _fault(reading: LidarPointsReading) -> ReadingFault | None:
    """Check a point cloud; return its fault or None."""
    points = reading.points_frd_m
    fault = array_fault(points, (None, 3), np.float32, "points")
    fault = fault or object_ids_fault(reading.object_ids, points.shape[:1])
    if fault is not None:
        return fault
    if len(points) == 0:
        return ReadingFault("empty", "the cloud has no points")
    if not np.isfinite(points).all():
        bad = int((~np.isfinite(points).all(axis=1)).sum())
        return ReadingFault("not_finite", f"{bad} of {len(points)} points are not finite")
    return None


def _rest_fault(reading: LidarPointsReading, _: Pose, __: LocalFrame) -> str | None:
    """Return what is wrong with a cloud around a vehicle at rest, in words; None for nothing."""
    middle_m = float(np.median(np.linalg.norm(reading.points_frd_m, axis=1)))
    if middle_m <= _FARTHEST_M:
        return None
    return f"half of its points are beyond {middle_m:.4g} m: its unit is wrong (metres)"


def _encode(reading: LidarPointsReading) -> Encoded:
    points = reading.points_frd_m
    fields = [
        {"name": name, "offset": 4 * k, "type": FLOAT32} for k, name in enumerate(("x", "y", "z"))
    ]
    packed, stride = points.astype("<f4").tobytes(), 12
    if reading.object_ids is not None:
        layout = np.dtype([("xyz", "<f4", 3), ("id", "u1")])
        rows: NDArray[np.void] = np.empty(len(points), layout)
        rows["xyz"], rows["id"] = points, reading.object_ids
        packed = rows.tobytes()
        fields.append({"name": "object_id", "offset": 12, "type": UINT8})
        stride = 13
    pose = pose_to_json(reading.mount)
    described = {"pose": pose, "point_stride": stride, "fields": fields}
    return described, packed


def _decode(document: Json, _: Parts) -> dict[str, Any]:
    stride = document["point_stride"]
    packed = np.frombuffer(bytes_from_base64(document["data"]), np.uint8).reshape(-1, stride)
    return {
        "points_frd_m": np.ascontiguousarray(packed[:, :12]).view("<f4"),
        "object_ids": packed[:, 12].copy() if stride == 13 else None,
        "mount": pose_from_json(document["pose"]),
    }


def _nearest_m(reading: LidarPointsReading) -> float | None:
    points = reading.points_frd_m
    return float(np.linalg.norm(points, axis=1).min()) if len(points) else None


_TRAITS = ReadingTraits(
    fault=_fault,
    schema=stamped_message_schema(
        "foxglove.PointCloud",
        pose=POSE_SCHEMA,
        point_stride=INTEGER,
        fields=schema_of_array(
            schema_of_object(
                "foxglove.PackedElementField", name=STRING, offset=INTEGER, type=INTEGER
            )
        ),
        data=BASE64,
    ),
    encode=_encode,
    decode=_decode,
    compared=lambda r: (r.points_frd_m.tobytes(),),
    elements="points_frd_m",
    ground_truth=("object_ids",),
    is_large=True,
    at_rest=_rest_fault,
    may_be_empty=True,
    visibility="wil_campaign.plugins.lidar.visibility:POINTS",
    quantities={"nearest_m": _nearest_m},
)
LIDAR_POINTS = SensorSpec(
    "lidar_points", LidarPointsReading, LidarPointsOptions, _model, traits=_TRAITS
)
