"""The filter that gives a kept part soft edges: how much of each pixel at its edge it covers."""

from dataclasses import replace
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from wil_campaign.recipes.model.registry import SidedParameters, StepContext, step
from wil_campaign.recipes.working import AnyMasked, Masked, Operator
from wil_campaign.vehicles.readings import BgrImage, CameraReading, Mask

Plane = NDArray[np.float32]

_LEAST_CONTRAST = 12.0
"""Steps of 8 bits between the kept part and its background: below, a pixel tells no cover."""
_LEAST_COVER, _WHOLE_COVER = 0.06, 0.94
_OFF_LINE = 0.35
"""A pixel whose colour is farther from the line between the two, in their distance, is neither."""


class MatteParameters(SidedParameters):
    """width_px: of the blended edge, on each side of the kept part's own: 1 for antialiasing."""

    shorthand = "width_px"

    width_px: Annotated[int, Field(ge=1, le=8)] = 1


@step("matte", stage="filter", sensors=("camera",), parameters=MatteParameters)
def matte(parameters: MatteParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Measure how much of each edge pixel the kept part covers, and take the background out of it.

    For images whose edges are blended with their background, after an isolation. image_bgr (h, w,
    3): an edge pixel C = a F + (1 - a) B gets the colour F, and its cover a as the mask's value (1
    to 254), by which `overlay` blends it. B is the mean of the background around, a the distance
    of C from B over the largest one nearby (as in Smith and Blinn, Blue screen matting, 1996, with
    F of the part itself). What is farther than width_px inside of the part stays whole.
    """
    radius_px = parameters.width_px

    def operator(
        work: Masked[CameraReading],
        other: AnyMasked | None,  # noqa: ARG001 - the interface
    ) -> Masked[CameraReading]:
        if work.mask is None:
            return work
        left, top, across, down = cv2.boundingRect(work.mask)
        if not across or not down:
            return work
        reach = 5 * radius_px
        rows = slice(max(0, top - reach), top + down + reach)
        columns = slice(max(0, left - reach), left + across + reach)
        image_bgr, mask = work.reading.image_bgr.copy(), work.mask.copy()
        found = _matted(image_bgr[rows, columns], mask[rows, columns], radius_px)
        image_bgr[rows, columns], mask[rows, columns] = found
        return Masked(replace(work.reading, image_bgr=image_bgr), mask)

    return operator


def _matted(image_bgr: BgrImage, mask: Mask, radius_px: int) -> tuple[BgrImage, Mask]:
    """Return a part of an image with the pure colours of its kept part, and their cover."""
    kept = (mask != 0).astype(np.uint8)
    core, near = cv2.erode(kept, _disc(radius_px)), cv2.dilate(kept, _disc(radius_px))
    away = (cv2.dilate(kept, _disc(2 * radius_px)) == 0).astype(np.float32)
    colours = image_bgr.astype(np.float32)
    ground, has_ground = _mean_where(colours, away, 4 * radius_px)
    apart = colours - ground
    toward, has_part = _mean_where(apart, kept.astype(np.float32), 2 * radius_px)
    toward /= np.maximum(np.linalg.norm(toward, axis=2, keepdims=True), 1e-6)
    along: Plane = np.einsum("ijk,ijk->ij", apart, toward).astype(np.float32)
    whole = cv2.dilate(np.where(kept != 0, along, 0.0).astype(np.float32), _disc(2 * radius_px))
    is_known = has_ground & has_part & (whole > _LEAST_CONTRAST)
    cover = np.where(is_known, along / np.maximum(whole, 1e-6), kept).astype(np.float32)
    off_line = np.linalg.norm(apart - along[:, :, None] * toward, axis=2) > _OFF_LINE * whole
    cover[(kept == 0) & off_line] = 0.0
    cover[cover < _LEAST_COVER] = 0.0
    cover[cover > _WHOLE_COVER] = 1.0
    cover[near == 0] = 0.0
    cover[core != 0] = 1.0
    blended = (cover > 0.0) & (cover < 1.0)
    pure = ground + apart / np.maximum(cover, _LEAST_COVER)[:, :, None]
    colours[blended] = pure[blended]
    made = np.clip(np.rint(colours), 0, 255).astype(np.uint8)
    return made, np.rint(cover * np.float32(255)).astype(np.uint8)


def _mean_where(planes: Plane, weight: Plane, radius_px: int) -> tuple[Plane, NDArray[np.bool_]]:
    """Return the mean of planes around each pixel where the weight is 1, and where there is one."""
    size = (2 * radius_px + 1, 2 * radius_px + 1)
    count = cv2.blur(weight, size, borderType=cv2.BORDER_CONSTANT)
    total = cv2.blur(planes * weight[:, :, None], size, borderType=cv2.BORDER_CONSTANT)
    is_some = count > 1e-4
    mean: Plane = (total / np.maximum(count, 1e-6)[:, :, None]).astype(np.float32)
    return mean, is_some


def _disc(radius_px: int) -> Mask:
    size = 2 * radius_px + 1
    disc: Mask = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    return disc
