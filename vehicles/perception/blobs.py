"""Finds the blob of one colour in an image: its area, place, opening and cut-off edges."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.vehicles.perception.hsv import HsvMask, HsvRange
from wil_campaign.vehicles.readings import BgrImage, Mask


@dataclass(frozen=True, slots=True)
class Borders:
    """Which edges of the image a blob touches."""

    left: bool
    top: bool
    right: bool
    bottom: bool

    @property
    def any(self) -> bool:
        """Return whether the blob may continue outside the image."""
        return self.left or self.top or self.right or self.bottom


@dataclass(frozen=True, slots=True)
class Box:
    """A blob's box in pixels; the far edges are those of the last pixels, included."""

    left_px: float
    top_px: float
    right_px: float
    bottom_px: float

    @property
    def width_px(self) -> float:
        """Return the box's width in pixels."""
        return self.right_px - self.left_px + 1.0

    @property
    def height_px(self) -> float:
        """Return the box's height in pixels."""
        return self.bottom_px - self.top_px + 1.0

    @property
    def centre_px(self) -> tuple[float, float]:
        """Return the box's middle (u, v)."""
        return (self.left_px + self.right_px) / 2.0, (self.top_px + self.bottom_px) / 2.0


@dataclass(frozen=True, slots=True)
class Opening:
    """The largest hole in a blob: what a gate's frame encloses.

    Where the blob is cut off by an edge of the image, that edge closes the hole. centre_px:
    (u, v), its centre of mass. across_px: left and right end of the row through the centre, halfway
    between the last pixels of hole and frame; None when the image's edge is one of them.
    down_px: likewise top and bottom of the column.
    """

    centre_px: tuple[float, float]
    across_px: tuple[float, float] | None
    down_px: tuple[float, float] | None


@dataclass(frozen=True, slots=True)
class Blob:
    """A blob of one colour in an image; pixels are those of the whole image.

    centroid_px: (u, v), the centre of mass of its visible part. opening: None when the blob
    encloses no hole.
    """

    area_px: float
    centroid_px: tuple[float, float]
    box: Box
    borders: Borders
    opening: Opening | None


class BlobFinder:
    """Finds the blob of a colour in images.

    decimate: every n-th pixel of a row and column is used, which costs n * n times less.
    min_area_fraction: of the image; smaller blobs are ignored. min_opening_fraction: of the blob's
    box; smaller holes are noise.
    """

    def __init__(
        self,
        ranges: Sequence[HsvRange],
        *,
        decimate: int = 2,
        min_area_fraction: float = 3e-4,
        min_opening_fraction: float = 0.15,
    ) -> None:
        self._mask_of = HsvMask(tuple(ranges)).of
        self._decimate = decimate
        self._min_area_fraction = min_area_fraction
        self._min_opening_fraction = min_opening_fraction

    def find(self, image_bgr: BgrImage) -> Blob | None:
        """Return the blob in a (height, width, 3) uint8 image; None when none is large enough.

        Parts whose box is below a quarter of the least area are specks, and ignored; all others
        form one blob, since a gate whose top is out of view is two bars.
        """
        mask = self._mask_of(_decimate(image_bgr, self._decimate))
        least_px = self._min_area_fraction * mask.size
        box = _without_specks(mask, least_px / 4.0)
        moments = cv2.moments(mask, binaryImage=True)
        if box is None or moments["m00"] < least_px:
            return None
        borders = _borders(box, mask)
        smallest_px = self._min_opening_fraction * box.width_px * box.height_px
        return _scale_to_image(
            Blob(
                area_px=moments["m00"],
                centroid_px=(moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]),
                box=box,
                borders=borders,
                opening=_find_opening(mask, borders, smallest_px),
            ),
            self._decimate,
        )


def _decimate(image_bgr: BgrImage, factor: int) -> BgrImage:
    """Return every n-th pixel of an image, to find blobs faster."""
    if factor == 1:
        return image_bgr
    size = (image_bgr.shape[1] // factor, image_bgr.shape[0] // factor)
    taken: BgrImage = cv2.resize(image_bgr, size, interpolation=cv2.INTER_NEAREST)
    return taken


def _without_specks(mask: Mask, least_px: float) -> Box | None:
    """Erase small blobs from the mask; return the box around the others, None without any."""
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    kept: list[tuple[int, int, int, int]] = []
    for contour in contours:
        left, top, width, height = cv2.boundingRect(contour)
        if width * height < least_px:
            cv2.drawContours(mask, [contour], 0, 0, cv2.FILLED)
        else:
            kept.append((left, top, left + width - 1, top + height - 1))
    if not kept:
        return None
    lefts, tops, rights, bottoms = zip(*kept, strict=True)
    return Box(min(lefts), min(tops), max(rights), max(bottoms))


def _borders(box: Box, mask: Mask) -> Borders:
    """Return which edges of the image a blob's box touches."""
    height_px, width_px = mask.shape
    return Borders(
        left=box.left_px <= 0,
        top=box.top_px <= 0,
        right=box.right_px >= width_px - 1,
        bottom=box.bottom_px >= height_px - 1,
    )


def _find_opening(mask: Mask, borders: Borders, smallest_px: float) -> Opening | None:
    """Return a blob's largest hole of at least this size; touched edges close it."""
    framed = cv2.copyMakeBorder(mask, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    for touched, edge in (
        (borders.left, framed[:, 0]),
        (borders.right, framed[:, -1]),
        (borders.top, framed[0]),
        (borders.bottom, framed[-1]),
    ):
        if touched:
            edge[:] = 255
    contours, hierarchy = cv2.findContours(framed, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    holes = [c for c, node in zip(contours, hierarchy[0], strict=True) if node[3] >= 0]
    largest = max(holes, key=cv2.contourArea, default=None)
    if largest is None or cv2.contourArea(largest) < max(smallest_px, 1.0):
        return None
    return _opening_of(largest, mask)


def _opening_of(contour: NDArray[np.int32], mask: Mask) -> Opening:
    """Return a blob's hole within a contour of frame pixels."""
    moments = cv2.moments(contour)
    u, v = moments["m10"] / moments["m00"] - 1.0, moments["m01"] / moments["m00"] - 1.0
    height_px, width_px = mask.shape
    column, row = min(max(round(u), 0), width_px - 1), min(max(round(v), 0), height_px - 1)
    return Opening((u, v), _gap(mask[row], column), _gap(mask[:, column], row))


def _gap(line: Mask, start: int) -> tuple[float, float] | None:
    """Return both ends of the gap in a blob around a place; None when the line ends it."""
    before, after = np.flatnonzero(line[:start]), np.flatnonzero(line[start:])
    if line[start] or not before.size or not after.size:
        return None
    return (float(before[-1]) + 0.5, float(start + after[0]) - 0.5)


def _scale_to_image(blob: Blob, factor: int) -> Blob:
    """Return the blob in pixels of the full image that was decimated by `factor`."""
    if factor == 1:
        return blob
    opening = blob.opening
    if opening is not None:
        opening = Opening(
            _times(opening.centre_px, factor),
            _times(opening.across_px, factor) if opening.across_px else None,
            _times(opening.down_px, factor) if opening.down_px else None,
        )
    return Blob(
        area_px=blob.area_px * factor * factor,
        centroid_px=_times(blob.centroid_px, factor),
        box=_scale(blob.box, factor),
        borders=blob.borders,
        opening=opening,
    )


def _times(point_px: tuple[float, float], factor: int) -> tuple[float, float]:
    """Return a blob's point in pixels of the full image."""
    return (point_px[0] * factor, point_px[1] * factor)


def _scale(box: Box, factor: int) -> Box:
    """Return a blob's box in pixels of the full image."""
    return Box(
        box.left_px * factor, box.top_px * factor, box.right_px * factor, box.bottom_px * factor
    )
