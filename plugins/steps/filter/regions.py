"""Filters by place: a region of an image, a sector of a lidar, a box of points."""

import math
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from wil_campaign.foundation.files.documents import Part
from wil_campaign.recipes.model.registry import SidedParameters, StepContext, step
from wil_campaign.recipes.operations.masks import intersect_masks, narrow_mask
from wil_campaign.recipes.operations.optics import ImageReading, image_size_px
from wil_campaign.recipes.operations.step_parameters import IMAGE_SENSORS, PAIR, Fraction
from wil_campaign.recipes.working import AnyMasked, CannotMixError, Masked, Operator
from wil_campaign.vehicles.readings import LidarPointsReading, LidarScanReading, Mask

Point = Annotated[list[Fraction], PAIR]


class BoxPart(Part):
    """A rectangular image region, as fractions of width and height from the top left.

    left: its left side, from the left edge of the image, 0 to 1. right: its right side, from the
    left edge. top: its upper side, from the upper edge of the image, 0 to 1. bottom: its lower
    side, from the upper edge.
    """

    left: Fraction = 0.0
    top: Fraction = 0.0
    right: Fraction = 1.0
    bottom: Fraction = 1.0

    @model_validator(mode="after")
    def _of_some_size(self) -> "BoxPart":
        """Refuse an image region's box whose corners are swapped."""
        if self.left >= self.right or self.top >= self.bottom:
            raise ValueError("left must be less than right, and top less than bottom")
        return self

    def corners(self) -> list[list[float]]:
        """Return the corners of the box region as a polygon."""
        return [
            [self.left, self.top],
            [self.right, self.top],
            [self.right, self.bottom],
            [self.left, self.bottom],
        ]


class IsolateRegionParameters(SidedParameters):
    """The region of the image that is kept: a box or a polygon.

    polygon: corners [x, y] as fractions of width and height, at least three. box: a rectangle, in
    place of a polygon. outside: keep the pixels outside instead.
    """

    box: BoxPart | None = None
    polygon: Annotated[list[Point], Field(min_length=3)] | None = None
    outside: bool = False

    @model_validator(mode="after")
    def _one_shape(self) -> "IsolateRegionParameters":
        if (self.box is None) == (self.polygon is None):
            raise ValueError("needs a box or a polygon")
        return self

    def corners(self) -> list[list[float]]:
        """Return the region's corners (across, down), as fractions."""
        if self.box is not None:
            return self.box.corners()
        return self.polygon or []


@step("isolate_region", stage="filter", sensors=IMAGE_SENSORS, parameters=IsolateRegionParameters)
def isolate_region(parameters: IsolateRegionParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Keep a part of an image: a box or a polygon, or the pixels outside of it.

    Corners are fractions of width and height, so that the step works for any size. A pixel is kept
    when its centre is inside.
    """
    corners, outside = parameters.corners(), parameters.outside
    masks: dict[tuple[int, int], Mask] = {}

    def operator(work: Masked[ImageReading], other: AnyMasked | None) -> Masked[ImageReading]:  # noqa: ARG001 - the interface
        size = image_size_px(work.reading)
        if size not in masks:
            masks.clear()
            masks[size] = region_mask(corners, size, outside=outside)
        return Masked(work.reading, intersect_masks(masks[size].copy(), work.mask))

    return operator


def region_mask(corners: list[list[float]], size: tuple[int, int], *, outside: bool) -> Mask:
    """Return the (height, width) mask of a polygon, by its even-odd rule on pixel centres."""
    width_px, height_px = size
    down, across = np.mgrid[0:height_px, 0:width_px]
    x, y = (across + 0.5) / width_px, (down + 0.5) / height_px
    inside = np.zeros((height_px, width_px), np.bool_)
    for (x0, y0), (x1, y1) in zip(corners, [*corners[1:], corners[0]], strict=True):
        if y0 == y1:
            continue
        crosses = (y0 > y) != (y1 > y)
        inside ^= crosses & (x < (x1 - x0) * (y - y0) / (y1 - y0) + x0)
    mask: Mask = np.where(inside != outside, 255, 0).astype(np.uint8)
    return mask


class IsolateDepthParameters(SidedParameters):
    """min_m, max_m: the region to keep in metres along the optical axis, both included."""

    needs = frozenset({"depth"})

    min_m: Annotated[float, Field(ge=0, le=1e9)] = 0.0
    max_m: Annotated[float, Field(gt=0, le=1e9)] = 1e9

    @model_validator(mode="after")
    def _in_order(self) -> "IsolateDepthParameters":
        """Refuse a depth region whose min_m is above its max_m."""
        if self.min_m > self.max_m:
            raise ValueError("min_m is above max_m")
        return self


@step("isolate_depth", stage="filter", sensors=IMAGE_SENSORS, parameters=IsolateDepthParameters)
def isolate_depth(parameters: IsolateDepthParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Keep the pixels whose depth lies in a range of metres along the optical axis.

    depth_m (height, width) float32. Drops the overlay ("no_depth") when an image has no depth.
    """
    low, high = parameters.min_m, parameters.max_m

    def operator(work: Masked[ImageReading], other: AnyMasked | None) -> Masked[ImageReading]:  # noqa: ARG001 - the interface
        depth_m = work.reading.depth_m
        if depth_m is None:
            raise CannotMixError("no_depth", "isolate_depth: the image has no depth")
        return Masked(work.reading, intersect_masks(cv2.inRange(depth_m, low, high), work.mask))

    return operator


class IsolateSectorParameters(SidedParameters):
    """A sector region: clockwise from from_deg to to_deg seen from above; 0 is forward.

    from_deg: its first direction, right of forward. to_deg: its last direction, right of forward.
    outside: keep the beams or points outside instead.
    """

    from_deg: Annotated[float, Field(ge=-360, le=360)]
    to_deg: Annotated[float, Field(ge=-360, le=720)]
    outside: bool = False


@step(
    "isolate_sector",
    stage="filter",
    sensors=("lidar", "lidar_points"),
    parameters=IsolateSectorParameters,
)
def isolate_sector(parameters: IsolateSectorParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Keep the beams or points of a sector around the sensor, or those outside of it.

    Angles in degrees from forward to the right; from 350 to 10 goes through forward.
    """
    p = parameters

    def operator(
        work: Masked[LidarScanReading] | Masked[LidarPointsReading],
        other: AnyMasked | None,  # noqa: ARG001 - the interface
    ) -> AnyMasked:
        inside = is_in_sector(element_angles_of(work.reading), p.from_deg, p.to_deg)
        return narrow_mask(work, inside != p.outside)

    return operator


def element_angles_of(reading: LidarScanReading | LidarPointsReading) -> NDArray[np.float64]:
    """Return each beam's or point's angle for a sector region, radians right of forward."""
    if isinstance(reading, LidarScanReading):
        return reading.angles_rad
    points = reading.points_frd_m
    return np.arctan2(points[:, 1], points[:, 0]).astype(np.float64)


def is_in_sector(
    angles_rad: NDArray[np.float64], from_deg: float, to_deg: float
) -> NDArray[np.bool_]:
    """Return which angles lie in a sector region; one of 360 degrees or more is all around."""
    if to_deg - from_deg >= 360.0:
        return np.ones(len(angles_rad), np.bool_)
    width = math.radians((to_deg - from_deg) % 360.0)
    past = np.mod(angles_rad - math.radians(from_deg), math.tau)
    # By rounding, a beam on the very first ray may be just below a full turn.
    inside = (past <= width + _RAY_RAD) | (past >= math.tau - _RAY_RAD)
    return np.asarray(inside, np.bool_)


_RAY_RAD = 1e-6


Reach = Annotated[float, Field(ge=-1e9, le=1e9)]


class IsolateBoxParameters(SidedParameters):
    """A box region in the sensor's frame.

    forward_m, right_m, down_m: [from, to] from the sensor; by default unbounded. outside: keep the
    points outside instead.
    """

    forward_m: Annotated[list[Reach], PAIR] = Field(default_factory=lambda: [-1e9, 1e9])
    right_m: Annotated[list[Reach], PAIR] = Field(default_factory=lambda: [-1e9, 1e9])
    down_m: Annotated[list[Reach], PAIR] = Field(default_factory=lambda: [-1e9, 1e9])
    outside: bool = False

    @field_validator("forward_m", "right_m", "down_m")
    @classmethod
    def _in_order(cls, pair: list[float]) -> list[float]:
        """Refuse a box region whose limits are swapped."""
        if pair[0] > pair[1]:
            raise ValueError(f"[{pair[0]}, {pair[1]}] has its limits in the wrong order")
        return pair


@step("isolate_box", stage="filter", sensors=("lidar_points",), parameters=IsolateBoxParameters)
def isolate_box(parameters: IsolateBoxParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Keep the points within a box of the sensor's frame (metres FRD), or those outside of it."""
    low, high = np.array(
        [parameters.forward_m, parameters.right_m, parameters.down_m], np.float32
    ).T

    def operator(
        work: Masked[LidarPointsReading],
        other: AnyMasked | None,  # noqa: ARG001 - the interface
    ) -> Masked[LidarPointsReading]:
        points = work.reading.points_frd_m
        inside = ((points >= low) & (points <= high)).all(axis=1)
        return narrow_mask(work, inside != parameters.outside)

    return operator
