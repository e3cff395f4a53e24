"""`limits`: bounds that are enforced on every setpoint before it is sent to a vehicle."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from wil_campaign.foundation.files.documents import KeyFaultError, Part
from wil_campaign.safety.guard.core.setpoint_limits import SetpointLimits

Range = Annotated[list[float], Field(min_length=2, max_length=2)]


class LimitsPart(Part):
    """The campaign's `limits` of setpoints for both vehicles; an absent one limits nothing.

    keep_m: distance of setpoints to the geofence and to the heights of up_m. speed_m_s: highest
    speed of a setpoint. acceleration_m_s2: highest change of a setpoint's velocity. up_m: lowest
    and highest setpoint, [low, high], up from the world's origin. inside_geofence: whether
    setpoints are kept inside the geofence.
    """

    speed_m_s: Annotated[float, Field(gt=0, le=1000)] | None = None
    acceleration_m_s2: Annotated[float, Field(gt=0, le=1000)] | None = None
    up_m: Range | None = None
    inside_geofence: bool = False
    keep_m: Annotated[float, Field(ge=0, le=1000)] = 0.3

    @model_validator(mode="after")
    def _some_room(self) -> Self:
        if self.up_m is None and not self.inside_geofence and "keep_m" in self.model_fields_set:
            raise KeyFaultError("keep_m", "has no effect without up_m or inside_geofence: true")
        if self.up_m is not None:
            low, high = self.up_m
            if low >= high:
                raise KeyFaultError("up_m", f"must be [low, high], is [{low:g}, {high:g}]")
            if high - low <= 2.0 * self.keep_m:
                message = f"leaves no room: keep_m, {self.keep_m:g} m, counts from both limits"
                raise KeyFaultError("up_m", message)
        return self

    def limits(self) -> SetpointLimits:
        """Return the setpoint limits as the guard takes them."""
        low, high = self.up_m or (None, None)
        return SetpointLimits(
            speed_m_s=self.speed_m_s,
            acceleration_m_s2=self.acceleration_m_s2,
            floor_up_m=low,
            ceiling_up_m=high,
            inside_fence=self.inside_geofence,
            keep_m=self.keep_m,
        )
