"""Merges that lay pictures over each other."""

from dataclasses import replace
from typing import Annotated

import cv2
from pydantic import Field, field_validator

from recipes.registry import Context, StepParameters, step
from recipes.working import CannotMixError, Masked, Merge, Side, Sides
from vehicles.readings import CameraReading
from worlds.camera import Intrinsics

MAX_DISAGREEMENT_PX = 1.0
"""How far apart two cameras may see the same point and still be laid over each other."""


class OverlayParameters(StepParameters):
    """priority: the sides from the top down; the last is the ground and fills what is left."""

    shorthand = "priority"

    priority: Annotated[list[Side], Field(min_length=2)]

    @field_validator("priority")
    @classmethod
    def _once_each(cls, priority: list[Side]) -> list[Side]:
        if len(set(priority)) != len(priority):
            raise ValueError("names a side twice")
        return priority


@step("overlay", stage="merge", sensors=("camera",), parameters=OverlayParameters)
def overlay(parameters: OverlayParameters, context: Context) -> Merge:  # noqa: ARG001 - the interface of steps
    """Lay the kept pixels of one picture over the other, by priority."""

    def merge(sides: Sides) -> CameraReading:
        layers = [sides[side] for side in parameters.priority if side in sides]
        ground = layers.pop()
        if not layers:
            return ground.reading
        for layer in layers:
            _refuse_mismatch(layer, ground)
        image_bgr = ground.reading.image_bgr.copy()
        for layer in reversed(layers):
            cv2.copyTo(layer.reading.image_bgr, layer.mask, image_bgr)
        return replace(ground.reading, image_bgr=image_bgr)

    return merge


def _refuse_mismatch(layer: Masked, ground: Masked) -> None:
    upper, lower = layer.reading, ground.reading
    if upper.image_bgr.shape != lower.image_bgr.shape:
        sizes = " over ".join(
            f"{reading.image_bgr.shape[1]} x {reading.image_bgr.shape[0]} ({reading.source})"
            for reading in (upper, lower)
        )
        raise CannotMixError("mismatch", f"overlay of {sizes}: add a resize step")
    apart_px = disagreement_px(upper.intrinsics, lower.intrinsics)
    if not apart_px <= MAX_DISAGREEMENT_PX:
        raise CannotMixError(
            "mismatch",
            f"overlay: the cameras see one point up to {apart_px:.1f} px apart;"
            " give both the same field of view",
        )


def disagreement_px(a: Intrinsics, b: Intrinsics) -> float:
    """Return how far apart two cameras of one size see a point at the corners, in pixels.

    Distortion that differs counts as infinitely far: nothing here undoes it.
    """
    if a == b:
        return 0.0
    if a.distortion != b.distortion:
        return float("inf")
    across = [abs((u - a.cx_px) / a.fx_px * b.fx_px + b.cx_px - u) for u in (0.0, a.width_px - 1.0)]
    down = [abs((v - a.cy_px) / a.fy_px * b.fy_px + b.cy_px - v) for v in (0.0, a.height_px - 1.0)]
    return max(*across, *down)
