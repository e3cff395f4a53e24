"""`geofence`: where each vehicle may be, and the distances and latency of the guard."""

from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from wil_campaign.safety.fence.fence_schema import FencePart
from wil_campaign.safety.guard.core.events import GuardSettings

_USUAL = GuardSettings()


class GeofencePart(FencePart):
    """The campaign's `geofence`: one fence for both vehicles, replaced by `real` and `twin`.

    keep_m: distance that each keeps to the fence. latency_s, braking_m_s2: how late, and then how
    hard, a vehicle brakes on the guard's command: the guard takes over a vehicle before it could
    no longer stop inside.
    """

    may_be_empty: ClassVar[bool] = True

    real: FencePart | None = None
    twin: FencePart | None = None
    keep_m: Annotated[float, Field(ge=0, le=1000)] = _USUAL.keep_m
    latency_s: Annotated[float, Field(ge=0, le=10)] = _USUAL.latency_s
    braking_m_s2: Annotated[float, Field(gt=0, le=100)] = _USUAL.braking_m_s2

    @property
    def of_vehicles(self) -> dict[str, FencePart]:
        """Return the fence of each vehicle that has one: its own, else that for both."""
        common = self if self.is_drawn else None
        parts = {"real": self.real or common, "twin": self.twin or common}
        return {name: part for name, part in parts.items() if part is not None}

    @model_validator(mode="after")
    def _for_somebody(self) -> Self:
        if not self.is_drawn and self.real is None and self.twin is None:
            raise ValueError("give a box; or include, exclude or file, and up_m; or real and twin")
        return self
