"""Transform that fills small holes in depth images."""

from dataclasses import replace
from typing import Annotated, Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from wil_campaign.recipes.model.registry import SidedParameters, StepContext, step
from wil_campaign.recipes.operations.optics import ImageReading
from wil_campaign.recipes.operations.step_parameters import IMAGE_SENSORS
from wil_campaign.recipes.working import AnyMasked, CannotMixError, Masked, Operator

Depth = NDArray[np.float32]


class FillDepthParameters(SidedParameters):
    """holes_px: the widest hole in a depth image that is filled."""

    shorthand = "holes_px"
    needs = frozenset({"depth"})

    holes_px: Annotated[int, Field(ge=1, le=200)] = 7


@step("fill_depth", stage="transform", sensors=IMAGE_SENSORS, parameters=FillDepthParameters)
def fill_depth(parameters: FillDepthParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Fill small holes in a depth image, so that no virtual object behind shows through them.

    depth_m (height, width) float32 metres; a hole is infinite, with finite depths around it. It is
    filled with the nearest distance that closes it; wide openings do not change. Drops the overlay
    ("no_depth") when an image has no depth.
    """
    width = parameters.holes_px + 1 + parameters.holes_px % 2
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (width, width))

    def operator(work: Masked[ImageReading], other: AnyMasked | None) -> Masked[ImageReading]:  # noqa: ARG001 - the interface
        depth_m = work.reading.depth_m
        if depth_m is None:
            raise CannotMixError("no_depth", "fill_depth: the image has no depth")
        return Masked(replace(work.reading, depth_m=_fill_holes(depth_m, disc)), work.mask)

    return operator


def _fill_holes(depth_m: Depth, disc: NDArray[Any]) -> Depth:
    """Return the depth with its holes filled by a morphological closing of the inverse depth.

    Finite depths do not change.
    """
    holes = np.isinf(depth_m)
    if not holes.any():
        return depth_m
    with np.errstate(divide="ignore"):
        nearness = np.float32(1.0) / np.maximum(depth_m, _NEAREST_M)
        closed = cv2.morphologyEx(nearness, cv2.MORPH_CLOSE, disc, borderType=cv2.BORDER_REPLICATE)
        filled = np.float32(1.0) / closed
    return np.where(holes, filled, depth_m).astype(np.float32)


_NEAREST_M = np.float32(1e-3)
"""Least depth in the inverse, which has to be finite."""
