"""Filters of measured distances: ranges of values, and decimation."""

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from wil_campaign.recipes.model.registry import SidedParameters, StepContext, step
from wil_campaign.recipes.operations.masks import narrow_mask
from wil_campaign.recipes.operations.step_parameters import RANGING
from wil_campaign.recipes.working import AnyMasked, Operator
from wil_campaign.vehicles.readings import (
    DepthReading,
    LidarPointsReading,
    LidarScanReading,
    RangefinderReading,
)

Ranging = DepthReading | LidarScanReading | LidarPointsReading | RangefinderReading


class ValueRangeParameters(SidedParameters):
    """min_m, max_m: metres, both included; keep: distances inside of these, or outside."""

    min_m: Annotated[float, Field(ge=0, le=1e9)] = 0.0
    max_m: Annotated[float, Field(gt=0, le=1e9)] = 1e9
    keep: Literal["inside", "outside"] = "inside"

    @model_validator(mode="after")
    def _in_order(self) -> "ValueRangeParameters":
        if self.min_m > self.max_m:
            raise ValueError("min_m is above max_m")
        return self


@step("value_range", stage="filter", sensors=RANGING, parameters=ValueRangeParameters)
def value_range(parameters: ValueRangeParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Keep, or drop, the distances that lie in a range of metres.

    Per beam, point (its distance from the sensor), pixel, or the one range of a rangefinder. A beam
    without a return (infinity) is outside of every range.
    """
    low, high = parameters.min_m, parameters.max_m

    def operator(work: AnyMasked, other: AnyMasked | None) -> AnyMasked:  # noqa: ARG001 - the interface
        distances = distances_of(work.reading)
        inside = (distances >= low) & (distances <= high)
        return narrow_mask(work, inside == (parameters.keep == "inside"))

    return operator


def distances_of(reading: Ranging) -> NDArray[np.float32]:
    """Return the range of each element of a reading in metres."""
    if isinstance(reading, DepthReading):
        return reading.depth_m
    if isinstance(reading, LidarScanReading):
        return reading.ranges_m
    if isinstance(reading, LidarPointsReading):
        return np.asarray(np.linalg.norm(reading.points_frd_m, axis=1), np.float32)
    return np.array([reading.range_m], np.float32)


class DecimateParameters(SidedParameters):
    """every: keeps each n-th beam or point of a ranging sensor; offset: the first kept."""

    shorthand = "every"

    every: Annotated[int, Field(ge=1, le=10_000)]
    offset: Annotated[int, Field(ge=0)] = 0

    @model_validator(mode="after")
    def _within(self) -> "DecimateParameters":
        """Refuse an offset that is not below `every` when decimating ranges."""
        if self.offset >= self.every:
            raise ValueError("offset must be below every")
        return self


@step("decimate", stage="filter", sensors=("lidar", "lidar_points"), parameters=DecimateParameters)
def decimate(parameters: DecimateParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Keep each n-th beam of a scan, or each n-th point."""

    def operator(work: AnyMasked, other: AnyMasked | None) -> AnyMasked:  # noqa: ARG001 - the interface
        chosen = np.zeros(len(distances_of(work.reading)), np.bool_)
        chosen[parameters.offset :: parameters.every] = True
        return narrow_mask(work, chosen)

    return operator
