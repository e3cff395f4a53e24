"""`actors`: objects of the world that are flown by vehicles of their own."""

from typing import Annotated, Literal

from pydantic import Field

from campaigns.schema.vehicles import ParameterName, Text
from vehicles.autopilots.autopilot import AutopilotName
from worlds.files.documents import Part


class ActorPart(Part):
    """A vehicle that flies as an object of the world, along the motion which that object has there.

    link: embedded, the one kind there is so far. autopilot: what flies it. profile: vehicle and
    place: air, motors, battery, estimator. params: parameters that it has from its start on.
    system_id: 3 and on without. max_offset_m: how far from its way it may be before the run is
    INVALID. max_delay_s: how much later than its motion it may be at a waypoint.
    """

    link: Literal["embedded"]
    autopilot: AutopilotName
    profile: Text = "nominal"
    params: dict[ParameterName, float] = Field(default_factory=dict)
    system_id: Annotated[int, Field(ge=1, le=250)] | None = None
    max_offset_m: Annotated[float, Field(gt=0, le=100)] = 0.5
    max_delay_s: Annotated[float, Field(gt=0, le=600)] = 3.0
