"""Lidars: what the beams of a 2-D or 3-D scanner meet, without noise.

Beams are ordered from left to right, rows from top to bottom, as a picture is. The sensor's
frame is FRD: the middle of a scan looks along forward.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from worlds.frames import Pose, matrix_from_quat
from worlds.rays.raycast import RayCaster
from worlds.scene.meshes import FloatArray
from worlds.scene.scene import NO_EVENTS

_FULL_CIRCLE_RAD = 2.0 * math.pi


@dataclass(frozen=True, slots=True)
class LidarModel:
    """A scanner's beams. A 2-D scanner has one row.

    columns: beams across horizontal_fov_rad, the outer ones on its edges; a full circle has
    no beam twice. rows: beams across vertical_fov_rad, the same. range_min_m, range_max_m:
    what is nearer or farther is not seen.
    """

    columns: int
    horizontal_fov_rad: float
    range_max_m: float
    range_min_m: float = 0.0
    rows: int = 1
    vertical_fov_rad: float = 0.0
    directions: FloatArray = field(init=False, repr=False, compare=False)
    """(rows * columns, 3) unit vectors in the sensor's FRD frame."""

    def __post_init__(self) -> None:
        if self.columns < 1 or self.rows < 1:
            raise ValueError("a lidar has at least one row and one column")
        if not 0.0 <= self.range_min_m < self.range_max_m:
            raise ValueError("range_min_m must be at least 0 and less than range_max_m")
        if not 0.0 <= self.horizontal_fov_rad <= _FULL_CIRCLE_RAD + 1e-9:
            raise ValueError("horizontal_fov_rad must be within 0 and 2 pi")
        if not 0.0 <= self.vertical_fov_rad <= math.pi:
            raise ValueError("vertical_fov_rad must be within 0 and pi")
        azimuth, elevation = np.meshgrid(self.azimuths_rad, self.elevations_rad)
        level = np.cos(elevation)
        directions = np.stack(
            [level * np.cos(azimuth), level * np.sin(azimuth), -np.sin(elevation)], axis=-1
        )
        object.__setattr__(self, "directions", directions.reshape(-1, 3))

    @property
    def azimuths_rad(self) -> FloatArray:
        """Return the beams' angles to the right of forward, (columns,)."""
        half = self.horizontal_fov_rad / 2.0
        if self.columns == 1:
            return np.zeros(1)
        circle = self.horizontal_fov_rad > _FULL_CIRCLE_RAD - 1e-9
        return np.linspace(-half, half, self.columns, endpoint=not circle)

    @property
    def elevations_rad(self) -> FloatArray:
        """Return the rows' angles above level, (rows,), the highest first."""
        half = self.vertical_fov_rad / 2.0
        return np.linspace(half, -half, self.rows) if self.rows > 1 else np.zeros(1)


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """What a scanner saw. ranges_m: (rows, columns) float32, inf for nothing within range.

    object_ids: (rows, columns) uint8, 0 for nothing.
    """

    ranges_m: NDArray[np.float32]
    object_ids: NDArray[np.uint8]


def scan(
    caster: RayCaster,
    model: LidarModel,
    sensor_pose: Pose,
    t_s: float,
    events: Mapping[str, float] = NO_EVENTS,
) -> Scan:
    """Return what a scanner sees from a pose (FRD axes, in the world) at a time."""
    directions = model.directions @ matrix_from_quat(sensor_pose.q_wxyz).T
    hits = caster.cast(sensor_pose.position_ned_m, directions, t_s, events)
    seen = (hits.ranges_m >= model.range_min_m) & (hits.ranges_m <= model.range_max_m)
    shape = (model.rows, model.columns)
    ranges_m = np.where(seen, hits.ranges_m, np.inf).astype(np.float32).reshape(shape)
    return Scan(ranges_m, np.where(seen, hits.object_ids, 0).astype(np.uint8).reshape(shape))
