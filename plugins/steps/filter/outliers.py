"""Filters against noise: removal of outliers, and medians."""

import math
from dataclasses import replace
from typing import Annotated, Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from wil_campaign.recipes.model.registry import SidedParameters, StepContext, step
from wil_campaign.recipes.operations.masks import narrow_mask
from wil_campaign.recipes.working import AnyMasked, Masked, Operator
from wil_campaign.vehicles.readings import (
    CameraReading,
    DepthReading,
    LidarPointsReading,
    LidarScanReading,
    RangefinderReading,
    Reading,
)


class RemoveOutliersParameters(SidedParameters):
    """Parameters of `remove_outliers`: an element is kept if it has enough near neighbours.

    window: neighbours to each side, beams or pixels (depth: 1 or 2). within_m: largest distance of
    a neighbour; of points, the side of the cube that it must share or touch. neighbours: least
    number of near ones.
    """

    window: Annotated[int, Field(ge=1, le=50)] = 2
    within_m: Annotated[float, Field(gt=0, le=1000)] = 0.3
    neighbours: Annotated[int, Field(ge=1, le=100)] = 1


@step(
    "remove_outliers",
    stage="filter",
    sensors=("depth", "lidar", "lidar_points"),
    parameters=RemoveOutliersParameters,
)
def remove_outliers(parameters: RemoveOutliersParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Drop isolated returns of a lidar or depth camera: those with too few near neighbours.

    Distances in metres. Beams without a return are kept. Points are counted in cubes of `within_m`
    and their 26 neighbours, without the point itself.
    """
    p = parameters

    def operator(work: AnyMasked, other: AnyMasked | None) -> AnyMasked:  # noqa: ARG001 - the interface
        reading = work.reading
        if isinstance(reading, LidarPointsReading):
            near = _near_points(reading.points_frd_m, p.within_m)
        elif isinstance(reading, DepthReading):
            near = _near(reading.depth_m, p.window, p.within_m, wraps=False)
            near += _near(reading.depth_m.T, p.window, p.within_m, wraps=False).T
            return narrow_mask(work, (near >= p.neighbours) | np.isinf(reading.depth_m))
        else:
            wraps = _is_full_turn(reading)
            near = _near(reading.ranges_m, p.window, p.within_m, wraps=wraps)
            return narrow_mask(work, (near >= p.neighbours) | np.isinf(reading.ranges_m))
        return narrow_mask(work, near >= p.neighbours)

    return operator


def _near(
    values: NDArray[np.float32], window: int, within_m: float, *, wraps: bool
) -> NDArray[np.int64]:
    """Return the count of near neighbours along the last axis, to find outliers; wraps: a ring."""
    near = np.zeros(values.shape, np.int64)
    with np.errstate(invalid="ignore"):
        for shift in range(1, window + 1):
            for signed in (shift, -shift):
                alike = np.abs(np.roll(values, signed, axis=-1) - values) <= within_m
                if not wraps:
                    ends = slice(None, signed) if signed > 0 else slice(signed, None)
                    alike[..., ends] = False
                near += alike
    return near


def _near_points(points: NDArray[np.float32], within_m: float) -> NDArray[np.int64]:
    """Return the number of near points of each point of a cloud, to find outliers."""
    if not len(points):
        return np.zeros(0, np.int64)
    cells = np.floor(points.astype(np.float64) / within_m).astype(np.int64)
    cells -= cells.min(axis=0) - 1
    across, along = cells[:, 1].max() + 2, cells[:, 2].max() + 2
    keys = (cells[:, 0] * across + cells[:, 1]) * along + cells[:, 2]
    known, counts = np.unique(keys, return_counts=True)
    near = np.full(len(points), -1, np.int64)
    for x in (-1, 0, 1):
        for y in (-1, 0, 1):
            for z in (-1, 0, 1):
                wanted = keys + (x * across + y) * along + z
                place = np.minimum(np.searchsorted(known, wanted), len(known) - 1)
                near += np.where(known[place] == wanted, counts[place], 0)
    return near


class MedianParameters(SidedParameters):
    """window: number of elements of the median, odd."""

    shorthand = "window"

    window: Annotated[int, Field(ge=3, le=99)] = 3

    @field_validator("window")
    @classmethod
    def _odd(cls, window: int) -> int:
        if window % 2 == 0:
            raise ValueError("must be odd")
        return window

    def refuses(self, kind: str) -> str:
        """Return why the median filter's window is too large for a sensor."""
        if kind == "depth" and self.window > 5:
            return "the median of a depth image takes a window of 3 or 5"
        return ""


@step(
    "median",
    stage="filter",
    sensors=("camera", "depth", "lidar", "rangefinder"),
    parameters=MedianParameters,
)
def median(parameters: MedianParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Replace each value by the median of those around it; of a rangefinder, of the last ones.

    Images: window x window pixels; scans: beams, across the ends of a full turn, with infinity as
    the largest value; rangefinder: metres over time. Shapes do not change.
    """
    return _Median(parameters.window)


def _is_full_turn(scan: LidarScanReading) -> bool:
    """Return whether a scan's last beam is the neighbour of its first."""
    return abs(len(scan.ranges_m) * abs(scan.step_rad) - math.tau) < abs(scan.step_rad) / 2


class _Median:
    """The median filter against outliers; of a rangefinder over its last readings."""

    def __init__(self, window: int) -> None:
        self._window = window
        self._past: list[tuple[float, float]] = []

    def __call__(self, work: AnyMasked, other: AnyMasked | None) -> AnyMasked:  # noqa: ARG002 - the interface
        return Masked(self._of(work.reading), work.mask)

    def _of(self, reading: Any) -> Reading:
        match reading:
            case CameraReading():
                return replace(reading, image_bgr=cv2.medianBlur(reading.image_bgr, self._window))
            case DepthReading():
                return replace(reading, depth_m=cv2.medianBlur(reading.depth_m, self._window))
            case LidarScanReading():
                return replace(reading, ranges_m=self._scan(reading))
            case _:
                return self._over_time(reading)

    def _scan(self, scan: LidarScanReading) -> NDArray[np.float32]:
        """Return a lidar scan filtered by the median along its beams."""
        half = self._window // 2
        mode: Literal["wrap", "edge"] = "wrap" if _is_full_turn(scan) else "edge"
        framed = np.pad(scan.ranges_m, half, mode=mode)
        windows = np.lib.stride_tricks.sliding_window_view(framed, self._window)
        return np.partition(windows, half, axis=1)[:, half]

    def _over_time(self, reading: RangefinderReading) -> RangefinderReading:
        """Return a rangefinder's reading filtered by the median of its last ranges."""
        if not self._past or reading.t_s > self._past[-1][0]:
            self._past.append((reading.t_s, reading.range_m))
            del self._past[: -self._window]
        values = sorted(value for _, value in self._past)
        return replace(reading, range_m=values[len(values) // 2])
