"""`faults`: signals of a vehicle that stop or freeze in flight, on purpose."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from wil_campaign.foundation.files.documents import Part
from wil_campaign.vehicles.faults import LATEST_S, LONGEST_S

Duration = Annotated[float, Field(gt=0, le=LONGEST_S)]
FlightStage = Literal["takeoff", "at_height", "goal", "done", "land"]
"""Stages of a flight after which a fault, or a link outage, may begin."""


class MomentPart(Part):
    """From `after_s` after a stage on, for `for_s` or until the end: `{on: goal, after_s: 1}`.

    on: the stage of the flight after which it begins. after_s: how long after the stage `on` it
    begins. for_s: how long it lasts; by default until the end of the run.
    """

    on: FlightStage
    after_s: Annotated[float, Field(ge=0, le=LATEST_S)] = 0.0
    for_s: Duration | None = None


class SignalFaultPart(Part):
    """A fault of one signal. stop: no more values; freeze: the last value is repeated."""

    stop: MomentPart | None = None
    freeze: MomentPart | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if (self.stop is None) == (self.freeze is None):
            raise ValueError("give stop, or freeze, with the stage `on` after which it begins")
        return self


class VehicleFaultsPart(Part):
    """Faults of a vehicle's signals: of its pose source, and of its sensors by name."""

    pose_source: SignalFaultPart | None = None
    sensors: dict[str, SignalFaultPart] = Field(default_factory=dict)


class FaultsPart(Part):
    """Faults of the pair; a vehicle that is not named has none."""

    real: VehicleFaultsPart | None = None
    twin: VehicleFaultsPart | None = None
