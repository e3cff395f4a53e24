"""Register the worlds: request the twin's reading from the pose of the real exposure.

The worlds are aligned by the pose of the requested reading, not by warping another one, as a warp
cannot show what a nearer object hides.
"""

from typing import Annotated

from pydantic import Field

from wil_campaign.recipes.model.registry import Context, StepParameters, step
from wil_campaign.recipes.working import Align, PoseRequest, Side

_FROM_A_PLACE = ("camera", "depth", "lidar", "lidar_points", "rangefinder")
"""Sensors of the surroundings, which a simulator can render from a requested pose."""


class RegisterParameters(StepParameters):
    """pose: of which vehicle. align: see PoseRequest. max_gap_ms: to the nearest pose sample."""

    pose: Side = "real"
    align: Align = "interpolate"
    max_gap_ms: Annotated[float, Field(gt=0, le=1000)] = 100.0


@step("register", stage="transform", sensors=_FROM_A_PLACE, parameters=RegisterParameters)
def register(parameters: RegisterParameters, context: Context) -> PoseRequest:  # noqa: ARG001 - the interface of steps
    """Take the twin's reading from a vehicle's pose at the time of the real one's exposure."""
    return PoseRequest(parameters.pose, parameters.align, parameters.max_gap_ms / 1000.0)
