"""The merge by priority: kept elements of one reading over those of the other, with soft edges."""

from dataclasses import replace
from typing import Annotated, Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from wil_campaign.recipes.model.registry import StepContext, StepParameters, step
from wil_campaign.recipes.operations.masks import is_kept, kept_elements
from wil_campaign.recipes.operations.optics import camera_disagreement_px
from wil_campaign.recipes.working import (
    AnyMasked,
    CannotMixError,
    Masked,
    Merge,
    Need,
    Side,
    Sides,
    refuse_other_elements,
)
from wil_campaign.vehicles.readings import BgrImage, CameraReading, DepthReading, Mask, Reading
from wil_campaign.vehicles.readings.kinds import traits_of

MAX_DISAGREEMENT_PX = 1.0
"""Largest distance of the same point in two images that may be laid over each other."""

TWIN_FIRST: tuple[Side, Side] = ("twin", "real")


def has_cover(mask: Mask) -> bool:
    """Return whether a mask has pixels that the kept part covers in part (1 to 254)."""
    return bool(cv2.countNonZero(cv2.inRange(mask, 1, 254)))


def blend_cover(layer_bgr: BgrImage, mask: Mask, ground_bgr: BgrImage) -> None:
    """Write the layer into `ground_bgr`, each pixel by the cover that its mask states."""
    cv2.copyTo(layer_bgr, cv2.inRange(mask, 255, 255), ground_bgr)
    rows, columns = np.nonzero(cv2.inRange(mask, 1, 254))
    weight = mask[rows, columns].astype(np.float32) / np.float32(255)
    upper, lower = (one[rows, columns].astype(np.float32) for one in (layer_bgr, ground_bgr))
    mixed = lower + (upper - lower) * weight[:, None]
    ground_bgr[rows, columns] = np.rint(mixed).astype(np.uint8)


class SoftEdge:
    """Blends a layer with soft edges over the ground, its weight rising from its edge inward.

    width_px: from the edge of the kept part (weight near 0) to where the layer is opaque. Weight
    is the distance to the edge over the width. Pixels outside of the mask, which show the layer's
    background, have none: there is no halo. The edges of the image are no edges of the object.
    Works on the box around the mask only.
    """

    def __init__(self, width_px: float) -> None:
        self._width_px = width_px

    def __call__(self, layer_bgr: BgrImage, shown: Mask | None, ground_bgr: BgrImage) -> None:
        """Write the soft-edged blend into `ground_bgr`; shown: kept and unhidden layer pixels.

        Where a nearer surface of the ground hides the layer, its edge fades as well.
        """
        if shown is None:
            np.copyto(ground_bgr, layer_bgr)
            return
        left, top, across, down = cv2.boundingRect(shown)
        if not across or not down:
            return
        rows, columns = slice(top, top + down), slice(left, left + across)
        weight = self._weights(shown, rows, columns)
        if has_cover(shown):
            weight = weight * (shown[rows, columns].astype(np.float32) / np.float32(255))
        part = ground_bgr[rows, columns]
        upper = layer_bgr[rows, columns].astype(np.float32)
        part[:] = np.rint(part + (upper - part) * weight[:, :, None]).astype(np.uint8)

    def _weights(self, shown: Mask, rows: slice, columns: slice) -> NDArray[np.float32]:
        """Return the soft edge's weights, 0 to 1 per pixel of the box around the shown pixels."""
        box = shown[rows, columns]
        height_px, width_px = shown.shape
        # A border of zeros where the box ends within the image; none where the image ends.
        framed = cv2.copyMakeBorder(box, 1, 1, 1, 1, cv2.BORDER_REPLICATE)
        if rows.start > 0:
            framed[0] = 0
        if rows.stop < height_px:
            framed[-1] = 0
        if columns.start > 0:
            framed[:, 0] = 0
        if columns.stop < width_px:
            framed[:, -1] = 0
        far = cv2.distanceTransform(framed, cv2.DIST_L2, cv2.DIST_MASK_5)[1:-1, 1:-1]
        weight: NDArray[np.float32] = np.minimum(far / np.float32(self._width_px + 1.0), 1.0)
        return weight


class OverlayParameters(StepParameters):
    """priority: the sides of the overlay from the top down; the last one is the ground.

    soft_edge_px: width of the band within the kept part in which it fades into the ground, for
    cameras. occlusion: `by_depth` draws a pixel of an image only where it is not farther than the
    ground's, and drops the overlay when a depth is missing; `where_known` does so only when both
    depths are available; `none` never.
    """

    shorthand = "priority"

    priority: Annotated[list[Side], Field(min_length=2)] = Field(
        default_factory=lambda: [*TWIN_FIRST]
    )
    soft_edge_px: Annotated[float, Field(ge=0, le=50)] = 0.0
    occlusion: Literal["by_depth", "where_known", "none"] = "where_known"

    @field_validator("priority")
    @classmethod
    def _once_each(cls, priority: list[Side]) -> list[Side]:
        if len(set(priority)) != len(priority):
            raise ValueError("names a side twice")
        return priority

    def needed(self) -> frozenset[Need]:
        """Return that an overlay with occlusion by depth needs depth."""
        return frozenset({"depth"}) if self.occlusion == "by_depth" else frozenset()

    def covers_with(self) -> Side | None:
        """Return the upper side of an overlay where no depth is compared."""
        return self.priority[0] if self.occlusion == "none" else None

    def refuses(self, kind: str) -> str:
        """Return why an overlay option makes no sense for a sensor type."""
        if self.soft_edge_px and kind != "camera":
            return f"a soft edge applies to camera images, not to {kind}"
        if self.occlusion == "by_depth" and kind not in ("camera", "depth"):
            return f"occlusion by depth applies to images, not to {kind}"
        return ""


@step(
    "overlay",
    stage="merge",
    sensors=lambda traits: traits.overlaid,
    parameters=OverlayParameters,
)
def overlay(parameters: OverlayParameters, context: StepContext) -> Merge:  # noqa: ARG001 - the interface of steps
    """Lay the kept elements of one reading over the other, by priority.

    Images of one size and camera (within 1 px); scans of the same beams; of readings of one value
    the first that is kept. Occlusion is decided by depth, metres along the optical axis.
    """
    soften = SoftEdge(parameters.soft_edge_px) if parameters.soft_edge_px else None
    occlusion = parameters.occlusion

    def merge(sides: Sides) -> Reading:
        layers = [sides[side] for side in parameters.priority if side in sides]
        ground = layers.pop()
        if not layers:
            return _lay_reading(ground)
        if isinstance(ground.reading, CameraReading):
            return _lay_images(layers, ground, occlusion, soften)
        return _plain(layers, ground, occlusion)

    return merge


def _lay_reading(work: AnyMasked) -> Reading:
    """Return the top layer's reading of an overlay of single values."""
    found: Reading = work.reading
    return found


def _lay_images(
    layers: list[AnyMasked],
    ground: Masked[CameraReading],
    occlusion: str,
    soften: SoftEdge | None,
) -> CameraReading:
    """Return the overlay of camera images: layers from the bottom up over the ground."""
    for layer in layers:
        refuse_mismatch(layer, ground)
    image_bgr = ground.reading.image_bgr.copy()
    for layer in reversed(layers):
        mask = _visible_mask(layer, ground, occlusion)
        if soften is not None:
            soften(layer.reading.image_bgr, mask, image_bgr)
        elif mask is not None and has_cover(mask):
            blend_cover(layer.reading.image_bgr, mask, image_bgr)
        else:
            cv2.copyTo(layer.reading.image_bgr, mask, image_bgr)
    return replace(ground.reading, image_bgr=image_bgr)


def _visible_mask(layer: AnyMasked, ground: AnyMasked, occlusion: str) -> Mask | None:
    """Return the overlay layer's mask without the pixels behind the ground's surfaces."""
    if occlusion == "none":
        return layer.mask
    upper, lower = layer.reading.depth_m, ground.reading.depth_m
    if upper is None or lower is None:
        if occlusion == "by_depth":
            without = layer.reading.source if upper is None else ground.reading.source
            raise CannotMixError("no_depth", f"overlay by depth: {without} has no depth")
        return layer.mask
    nearer: Mask = cv2.compare(upper, lower, cv2.CMP_LE)
    return nearer if layer.mask is None else cv2.bitwise_and(nearer, layer.mask, dst=nearer)


def _plain(layers: list[AnyMasked], ground: AnyMasked, occlusion: str) -> Reading:
    """Return the overlay of depth images, scans or single values."""
    reading: Any = ground.reading
    for layer in reversed(layers):
        upper = layer.reading
        if isinstance(reading, DepthReading):
            refuse_mismatch(layer, ground)
            mask = layer.mask if occlusion == "none" else _visible_mask(layer, ground, occlusion)
            depth_m = reading.depth_m.copy()
            cv2.copyTo(upper.depth_m, mask, depth_m)
            reading = replace(reading, depth_m=depth_m)
        elif name := traits_of(type(reading)).elements:
            refuse_other_elements("overlay", upper, reading)
            kept = np.where(kept_elements(layer), getattr(upper, name), getattr(reading, name))
            reading = replace(reading, **{name: kept})
        elif is_kept(layer):
            reading = upper
    return _lay_reading(Masked(reading))


def refuse_mismatch(layer: AnyMasked, ground: AnyMasked) -> None:
    """Raise CannotMixError for overlaid images of different size or camera."""
    upper, lower = layer.reading, ground.reading
    a, b = upper.intrinsics, lower.intrinsics
    if (a.width_px, a.height_px) != (b.width_px, b.height_px):
        sizes = " over ".join(
            f"{one.width_px} x {one.height_px} ({reading.source})"
            for one, reading in ((a, upper), (b, lower))
        )
        raise CannotMixError("mismatch", f"overlay of {sizes}: add a resize step")
    apart_px = camera_disagreement_px(a, b)
    if not apart_px <= MAX_DISAGREEMENT_PX:
        raise CannotMixError(
            "mismatch",
            f"overlay: the cameras project one point up to {apart_px:.1f} px apart;"
            " give both the same field of view, or add a camera_model step",
        )
