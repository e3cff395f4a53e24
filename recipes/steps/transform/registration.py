"""Register the worlds: say from which pose the twin's picture is to be taken.

The worlds are aligned by the reading that is asked for, not by warping one that is there: no
warp knows what a nearer object hides.
"""

from typing import Annotated

from pydantic import Field

from recipes.model.registry import Context, StepParameters, step
from recipes.working import Align, PoseRequest, Side

_FROM_A_PLACE = ("camera", "depth", "lidar", "lidar_points", "rangefinder")
"""Sensors whose readings are of a place, so that a simulator can be asked for them from one."""


class RegisterParameters(StepParameters):
    """pose: whose it is. align: see PoseRequest. max_gap_ms: to the nearest pose sample."""

    pose: Side = "real"
    align: Align = "interpolate"
    max_gap_ms: Annotated[float, Field(gt=0, le=1000)] = 100.0


@step("register", stage="transform", sensors=_FROM_A_PLACE, parameters=RegisterParameters)
def register(parameters: RegisterParameters, context: Context) -> PoseRequest:  # noqa: ARG001 - the interface of steps
    """Take the twin's reading from a vehicle's pose at the time of the real one's exposure."""
    return PoseRequest(parameters.pose, parameters.align, parameters.max_gap_ms / 1000.0)
