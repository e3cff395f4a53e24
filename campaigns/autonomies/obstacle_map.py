"""A map of obstacles from depth images, and how free each heading is; pure.

Occupied cells at the vehicle's height, and how near each heading leads past them: the vector field
histogram (Borenstein and Koren, IEEE Trans. Robotics and Automation 7, 1991) with the distance
itself in place of a count.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from wil_campaign.api import DepthReading, Pose, Quat, rotate

CELL_M = 0.2
HEADINGS = 72
"""Number of evaluated directions: 5 degrees apart."""
_STRIDE_PX = 3
_LEAST_POINTS = 3
"""Least number of points of one image in an occupied cell: a single one is noise."""
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FreeWays:
    """How free each heading is. headings_rad: (headings,), from north to the east.

    beside_m: distance of the nearest obstacle beside the way, inf without one. ahead_m: length of
    the way until an obstacle is nearer than the least distance.
    """

    headings_rad: Floats
    beside_m: Floats
    ahead_m: Floats


@dataclass(slots=True)
class ObstacleMap:
    """Occupied cells, north and east, with the time of their last sight; forgets after memory_s.

    look_m: range. half_height_m: obstacles up to so far above and below the vehicle count.
    """

    look_m: float
    half_height_m: float
    memory_s: float
    _last_seen_s: dict[tuple[int, int], float] = field(default_factory=dict)

    def add(self, reading: DepthReading, pose: Pose, q_wxyz: Quat) -> None:
        """Add the points of a depth image at the vehicle's height. q_wxyz: camera to NED."""
        points = _points_ned(reading, q_wxyz, self.look_m)
        if len(points):
            points = points[np.abs(points[:, 2]) <= self.half_height_m]
        north, east, _ = pose.position_ned_m
        cells = np.floor((points[:, :2] + np.array([north, east])) / CELL_M).astype(int)
        occupied, counts = np.unique(cells, axis=0, return_counts=True)
        for row, column in occupied[counts >= _LEAST_POINTS].tolist():
            self._last_seen_s[row, column] = reading.t_s

    def offsets(self, pose: Pose, now_s: float) -> Floats:
        """Return the occupied cells in range, (cells, 2): north and east of the vehicle."""
        self._last_seen_s = {
            cell: t_s for cell, t_s in self._last_seen_s.items() if now_s - t_s <= self.memory_s
        }
        if not self._last_seen_s:
            return np.empty((0, 2))
        middles = (np.array(list(self._last_seen_s), dtype=float) + 0.5) * CELL_M
        offsets: Floats = middles - np.array(pose.position_ned_m[:2])
        return offsets[np.hypot(offsets[:, 0], offsets[:, 1]) <= self.look_m]


def free_ways(offsets: Floats, *, least_m: float, within_m: float) -> FreeWays:
    """Return how free each heading is. offsets: (cells, 2), north and east.

    least_m: an obstacle nearer than this to a way closes it. within_m: length of evaluated ways.
    """
    headings: Floats = np.arange(HEADINGS, dtype=float) * (2.0 * math.pi / HEADINGS)
    beside: Floats = np.full(HEADINGS, np.inf)
    ahead: Floats = np.full(HEADINGS, within_m)
    if len(offsets):
        along = np.outer(np.cos(headings), offsets[:, 0]) + np.outer(
            np.sin(headings), offsets[:, 1]
        )
        across = np.outer(np.cos(headings), offsets[:, 1]) - np.outer(
            np.sin(headings), offsets[:, 0]
        )
        before = (along > 0.0) & (along <= within_m)
        side = np.where(before, np.abs(across), np.inf)
        beside = side.min(axis=1)
        # The circle of the least distance round a cell begins half a chord before the cell.
        chord = np.sqrt(np.maximum(least_m**2 - across**2, 0.0))
        closes = before & (np.abs(across) < least_m)
        reached = np.where(closes, np.maximum(along - chord, 0.0), within_m)
        ahead = reached.min(axis=1)
    return FreeWays(headings, beside, ahead)


def _points_ned(reading: DepthReading, q_wxyz: Quat, look_m: float) -> Floats:
    """Return the points of a depth image, (points, 3) NED metres from the camera."""
    depth = reading.depth_m[::_STRIDE_PX, ::_STRIDE_PX].astype(float)
    rows, columns = np.nonzero(np.isfinite(depth) & (depth > 0.0) & (depth <= look_m))
    lens, z = reading.intrinsics, depth[rows, columns]
    right = (columns * _STRIDE_PX - lens.cx_px) / lens.fx_px * z
    down = (rows * _STRIDE_PX - lens.cy_px) / lens.fy_px * z
    axes = np.array([rotate(q_wxyz, axis) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1))])
    points: Floats = np.stack([z, right, down], axis=1) @ axes
    return points
