"""Transform of a scan to other beams."""

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from wil_campaign.foundation.files.documents import Part
from wil_campaign.plugins.lidar.scans import with_beams
from wil_campaign.recipes.model.registry import SidedParameters, StepContext, step
from wil_campaign.recipes.operations.step_parameters import Degrees
from wil_campaign.recipes.steps.transform.geometry import refuse_own_side
from wil_campaign.recipes.working import CannotMixError, Masked, Operator, Side
from wil_campaign.vehicles.readings import LidarScanReading

Work = Masked[LidarScanReading]


class BeamsPart(Part):
    """Lidar beams: count, the first at start_deg right of forward, each step_deg further.

    count: number of beams. start_deg: direction of the first beam, right of forward. step_deg: from
    one beam to the next.
    """

    count: Annotated[int, Field(ge=1, le=100_000)]
    start_deg: Degrees
    step_deg: Annotated[float, Field(gt=0, le=360)]


class ResampleBeamsParameters(SidedParameters):
    """to: the other side, whose beams are used, or beams."""

    shorthand = "to"
    reshapes = True

    to: Literal["real", "twin"] | BeamsPart

    @model_validator(mode="after")
    def _not_to_itself(self) -> "ResampleBeamsParameters":
        refuse_own_side(self, self.to, "beams")
        return self

    def like(self) -> Side | None:
        """Return the side whose beams are taken."""
        return self.to if isinstance(self.to, str) else None


@step("resample_beams", stage="transform", sensors=("lidar",), parameters=ResampleBeamsParameters)
def resample_beams(parameters: ResampleBeamsParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Give a scan other beams, each with the range of the old beam nearest in angle.

    ranges_m (beams,) float32 metres to (beams',). A beam outside of the old scan is infinity, and
    not kept.
    """
    to = parameters.to

    def operator(work: Work, other: Work | None) -> Work:
        if isinstance(to, BeamsPart):
            start, step_rad = math.radians(to.start_deg), math.radians(to.step_deg)
            return with_beams(work, count=to.count, start_angle_rad=start, step_rad=step_rad)
        if other is None:
            missing: Literal["no_real", "no_twin"] = "no_real" if to == "real" else "no_twin"
            raise CannotMixError(missing, f"resample_beams to {to}: there is no scan of {to}")
        like = other.reading
        return with_beams(
            work,
            count=len(like.ranges_m),
            start_angle_rad=like.start_angle_rad,
            step_rad=like.step_rad,
        )

    return operator
