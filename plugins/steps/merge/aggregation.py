"""The merge by arithmetic: mean, median, minimum, maximum, or a weighted mean of both sides."""

from collections.abc import Callable
from dataclasses import replace
from typing import Annotated, Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from wil_campaign.plugins.steps.operations.interpolation import interpolated_reading
from wil_campaign.recipes.model.registry import StepContext, StepParameters, step
from wil_campaign.recipes.operations.masks import is_kept, kept_elements
from wil_campaign.recipes.steps.merge.overlays import refuse_mismatch
from wil_campaign.recipes.working import (
    AnyMasked,
    CannotMixError,
    Masked,
    Merge,
    Sides,
    refuse_other_elements,
)
from wil_campaign.vehicles.readings import (
    CameraReading,
    DepthReading,
    GpsReading,
    ImuReading,
    LidarScanReading,
    PoseReading,
    RangefinderReading,
    Reading,
)

By = Literal["mean", "median", "min", "max", "weighted"]
Weight = Annotated[float, Field(ge=0, le=1e6)]
Floats = NDArray[np.float64]

_PLACES = ("pose", "gps")


class AggregateParameters(StepParameters):
    """by: the operation. real_weight, twin_weight: of the weighted mean, not both 0."""

    shorthand = "by"

    by: By
    real_weight: Weight = 1.0
    twin_weight: Weight = 1.0

    @model_validator(mode="after")
    def _some_weight(self) -> "AggregateParameters":
        if self.real_weight + self.twin_weight <= 0.0:
            raise ValueError("the weights must not both be 0")
        given = {"real_weight", "twin_weight"} & self.model_fields_set
        if given and self.by != "weighted":
            raise ValueError(f"weights are for 'weighted', not for '{self.by}'")
        return self

    def refuses(self, kind: str) -> str:
        """Return why an aggregation makes no sense for a sensor type."""
        if kind in _PLACES and self.by in ("min", "max"):
            return f"readings of a {kind} have no {self.by}; use mean, median or weighted"
        return ""


@step(
    "aggregate",
    stage="merge",
    sensors=("camera", "depth", "lidar", "rangefinder", "gps", "pose", "imu"),
    parameters=AggregateParameters,
)
def aggregate(parameters: AggregateParameters, context: StepContext) -> Merge:  # noqa: ARG001 - the interface of steps
    """Combine the values of both sides: mean, median, minimum, maximum, weighted mean.

    Per pixel and channel, beam, axis or range. An element that one side does not keep is the
    other's. Ranges and depths in metres: infinity (no return) enters no mean. The median of two is
    their mean. Attitudes along the shortest arc; positions on WGS-84 linearly, also across the date
    line.
    """
    weights = (
        (parameters.real_weight, parameters.twin_weight)
        if parameters.by == "weighted"
        else (1.0, 1.0)
    )
    combine = _combiner(parameters.by, weights)
    share = weights[1] / (weights[0] + weights[1])

    def merge(sides: Sides) -> Reading:
        real = sides["real"]
        if "twin" not in sides:
            alone: Reading = real.reading
            return alone
        if isinstance(real.reading, CameraReading):
            return _merge_images(real, sides["twin"], parameters.by, share)
        return _merge_values(real, sides["twin"], combine, share)

    return merge


Combine = Callable[[Floats, Floats], Floats]


def _combiner(by: By, weights: tuple[float, float]) -> Combine:
    """Return the aggregation of two arrays in which NaN means no value."""

    def extreme(a: Floats, b: Floats) -> Floats:
        made = np.fmin(a, b) if by == "min" else np.fmax(a, b)
        return np.asarray(made, np.float64)

    def mean(a: Floats, b: Floats) -> Floats:
        wa, wb = (
            np.where(np.isfinite(values), weight, 0.0)
            for values, weight in zip((a, b), weights, strict=True)
        )
        total = wa + wb
        sums = np.where(wa > 0, a, 0.0) * wa + np.where(wb > 0, b, 0.0) * wb
        with np.errstate(invalid="ignore", divide="ignore"):
            made = sums / total
        # Neither is a finite number with a weight: no return, or not kept.
        return np.where(total > 0.0, made, np.fmin(a, b))

    return extreme if by in ("min", "max") else mean


def _merge_values(real: AnyMasked, twin: AnyMasked, combine: Combine, share: float) -> Reading:
    """Return the aggregated reading of two sides. share: of the twin in a mean."""
    match real.reading:
        case DepthReading() as one:
            refuse_mismatch(twin, real)
            depth = _distances(real, one.depth_m, twin, twin.reading.depth_m, combine)
            return replace(one, depth_m=depth)
        case LidarScanReading() as one:
            refuse_other_elements("aggregate", one, twin.reading)
            ranges = _distances(real, one.ranges_m, twin, twin.reading.ranges_m, combine)
            return replace(one, ranges_m=ranges)
        case RangefinderReading() as one:
            pair = (np.array([side.reading.range_m], np.float64) for side in (real, twin))
            a, b = pair
            (value,) = _distances(real, a, twin, b, combine)
            return replace(one, range_m=float(value))
        case ImuReading() as one:
            return _imu(real, one, twin, combine)
        case other:
            return _place(real, other, twin, share)


def _merge_images(
    real: Masked[CameraReading], twin: Masked[CameraReading], by: By, share: float
) -> CameraReading:
    """Return two images aggregated where both are kept; else the kept one; else the real one."""
    refuse_mismatch(twin, real)
    a, b = real.reading.image_bgr, twin.reading.image_bgr
    if by in ("min", "max"):
        made = cv2.min(a, b) if by == "min" else cv2.max(a, b)
    else:
        made = cv2.addWeighted(a, 1.0 - share, b, share, 0.0)
    if real.mask is not None:
        cv2.copyTo(b, cv2.inRange(real.mask, 0, 0), made)
    if twin.mask is not None:
        cv2.copyTo(a, cv2.inRange(twin.mask, 0, 0), made)
    return replace(real.reading, image_bgr=made)


def _distances(
    real: AnyMasked, of_real: NDArray[Any], twin: AnyMasked, of_twin: NDArray[Any], combine: Combine
) -> NDArray[np.float32]:
    """Return aggregated distances; infinity where neither side is kept."""
    a = np.where(kept_elements(real), of_real, np.nan).astype(np.float64)
    b = np.where(kept_elements(twin), of_twin, np.nan).astype(np.float64)
    made = combine(a, b)
    return np.where(np.isnan(made), np.inf, made).astype(np.float32)


def _imu(real: AnyMasked, one: ImuReading, twin: AnyMasked, combine: Combine) -> ImuReading:
    """Return the aggregated IMU reading of two sides."""
    if not is_kept(twin):
        return one
    other: ImuReading = twin.reading
    if not is_kept(real):
        return other
    force = combine(np.array(one.specific_force_frd_m_s2), np.array(other.specific_force_frd_m_s2))
    rates = combine(np.array(one.rates_frd_rad_s), np.array(other.rates_frd_rad_s))
    return replace(
        one,
        specific_force_frd_m_s2=(float(force[0]), float(force[1]), float(force[2])),
        rates_frd_rad_s=(float(rates[0]), float(rates[1]), float(rates[2])),
    )


def _place(real: AnyMasked, one: Any, twin: AnyMasked, share: float) -> PoseReading | GpsReading:
    """Return the aggregated place (pose or fix): the interpolation between both sides."""
    if not is_kept(twin) or share == 0.0:
        kept_real: PoseReading | GpsReading = one
        return kept_real
    if not is_kept(real) or share == 1.0:
        kept_twin: PoseReading | GpsReading = twin.reading
        return kept_twin
    made = interpolated_reading(replace(one, t_s=0.0), replace(twin.reading, t_s=1.0), share)
    if not isinstance(made, PoseReading | GpsReading):
        raise CannotMixError("mismatch", "aggregate: the two readings differ in type")
    return made
