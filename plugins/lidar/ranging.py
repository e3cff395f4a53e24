"""What lidars and rangefinders have in common: their keys, checks, and limits in MAVLink."""

import math
from dataclasses import replace
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from wil_campaign.foundation.files.documents import KeyFaultError
from wil_campaign.plugins.lidar.beams import RangeNoise
from wil_campaign.vehicles.readings.faults import ReadingFault
from wil_campaign.vehicles.readings.messages import (
    NUMBER,
    POSE_SCHEMA,
    schema_of_array,
    stamped_message_schema,
)
from wil_campaign.vehicles.sensors.sensor_spec import MountedOptions
from wil_campaign.vehicles.sources.readings.live_readings import UnusableReadingError

LASER_SCAN = stamped_message_schema(
    "foxglove.LaserScan",
    pose=POSE_SCHEMA,
    start_angle=NUMBER,
    end_angle=NUMBER,
    ranges=schema_of_array(NUMBER),
    intensities=schema_of_array(NUMBER),
)
_SAME_REACH = 0.02
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


def without_range_noise(noise: RangeNoise) -> RangeNoise:
    """Return a lidar's noise settings without noise, with the same range limits."""
    return RangeNoise(noise.range_min_m, noise.range_max_m)


def ranging_limits_fault(min_m: float, max_m: float) -> ReadingFault | None:
    """Check a ranging reading's limits; return their fault or None."""
    if not (0.0 <= min_m < max_m < math.inf):
        return ReadingFault(
            "out_of_range",
            f"the range limits are {min_m} to {max_m} m: the lower must be 0 or more, and the "
            "upper greater and finite",
        )
    return None


def require_reach(options: Any, min_m: float, max_m: float) -> None:
    """Raise UnusableReadingError unless a message states the limits that the campaign gives.

    options: the sensor's keys, RangingOptions, where limits may be left out.
    """
    given = (
        (options.range_min_m, options.range_max_m)
        if isinstance(options, RangingOptions)
        else (None, None)
    )
    for key, wanted, stated in zip(
        ("range_min_m", "range_max_m"), given, (min_m, max_m), strict=True
    ):
        if wanted is not None and abs(wanted - stated) > _SAME_REACH * max(wanted, stated):
            raise UnusableReadingError(
                f"the message states {stated:g} m and the campaign {key}: {wanted:g}; one of "
                f"the two has another unit: correct it, or leave out {key}"
            )
