"""Transforms of a picture's geometry."""

from dataclasses import replace
from typing import Annotated, Literal, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from recipes.registry import Context, SidedParameters, step
from recipes.working import CannotMixError, DropReason, Masked, Operator
from worlds.camera import Intrinsics
from worlds.documents import KeyFaultError, Part

Pixel = TypeVar("Pixel", np.uint8, np.float32)
SizePx = Annotated[int, Field(ge=1, le=16384)]


class Size(Part):
    """A size in pixels."""

    width_px: SizePx
    height_px: SizePx


class ResizeParameters(SidedParameters):
    """to: the other side, whose size to take, or a size."""

    shorthand = "to"

    to: Literal["real", "twin"] | Size

    @model_validator(mode="after")
    def _not_to_itself(self) -> "ResizeParameters":
        if self.to in self.sides():
            raise KeyFaultError("to", f"{self.to} would take its own size; 'on' says {self.on}")
        return self


@step("resize", stage="transform", sensors=("camera",), parameters=ResizeParameters)
def resize(parameters: ResizeParameters, context: Context) -> Operator:  # noqa: ARG001 - the interface of steps
    """Scale a picture to a size, or to the other side's, with its intrinsics, depth and ids."""
    to = parameters.to

    def operator(work: Masked, other: Masked | None) -> Masked:
        if isinstance(to, Size):
            return resized(work, to.width_px, to.height_px)
        if other is None:
            missing: DropReason = "no_real" if to == "real" else "no_twin"
            raise CannotMixError(missing, f"resize to {to}: there is no picture of {to}")
        height_px, width_px = other.reading.image_bgr.shape[:2]
        return resized(work, width_px, height_px)

    return operator


def resized(work: Masked, width_px: int, height_px: int) -> Masked:
    """Return the picture scaled to a size in pixels.

    Colours are averaged over areas when both sides shrink, else interpolated linearly. Depth, ids
    and mask take the nearest pixel: between two objects there is no third.
    """
    reading = work.reading
    if reading.image_bgr.shape[:2] == (height_px, width_px):
        return work
    size = (width_px, height_px)
    shrinks = width_px <= reading.image_bgr.shape[1] and height_px <= reading.image_bgr.shape[0]
    kind = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    scaled = replace(
        reading,
        image_bgr=cv2.resize(reading.image_bgr, size, interpolation=kind),
        intrinsics=scaled_intrinsics(reading.intrinsics, width_px, height_px),
        depth_m=_nearest(reading.depth_m, size),
        object_ids=_nearest(reading.object_ids, size),
    )
    return Masked(scaled, _nearest(work.mask, size))


def scaled_intrinsics(intrinsics: Intrinsics, width_px: int, height_px: int) -> Intrinsics:
    """Return the intrinsics of the same view at another size.

    The edges of the picture stay where they are, at -0.5 and width - 0.5 (pixel (0, 0) is the
    centre of the first pixel): u' = (u + 0.5) width'/width - 0.5. Distortion has no unit.
    """
    across, down = width_px / intrinsics.width_px, height_px / intrinsics.height_px
    return Intrinsics(
        width_px=width_px,
        height_px=height_px,
        fx_px=intrinsics.fx_px * across,
        fy_px=intrinsics.fy_px * down,
        cx_px=(intrinsics.cx_px + 0.5) * across - 0.5,
        cy_px=(intrinsics.cy_px + 0.5) * down - 0.5,
        distortion=intrinsics.distortion,
    )


def _nearest(plane: NDArray[Pixel] | None, size: tuple[int, int]) -> NDArray[Pixel] | None:
    if plane is None:
        return None
    scaled: NDArray[Pixel] = cv2.resize(plane, size, interpolation=cv2.INTER_NEAREST_EXACT)
    return scaled
