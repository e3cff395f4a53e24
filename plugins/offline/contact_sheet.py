"""A contact sheet of one mixture: both images, the output of each step, the result."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from wil_campaign.recipes.pipeline.stages import StageView
from wil_campaign.vehicles.perception.depth_colors import color_depth
from wil_campaign.vehicles.readings import BgrImage, CameraReading, DepthReading, Mask, Reading

_TILE_PX = 480
_LABEL_PX = 26
_COLUMNS = 3
_SQUARE_PX = 12
_ZOOM = 6


@dataclass(frozen=True, slots=True)
class _Tile:
    """A tile of a contact sheet: a label and an image."""

    label: str
    image_bgr: BgrImage


class ContactSheet:
    """Draws a contact sheet of the outputs of a recipe's steps for one frame; an observer.

    frame: its index from 0. Pixels that a mask leaves out are shown as grey squares.
    """

    def __init__(self, *, frame: int = 0) -> None:
        self._wanted = frame
        self._frame = -1
        self._step = 0
        self._tiles: list[_Tile] = []
        self._edge: tuple[int, int] | None = None

    @property
    def is_empty(self) -> bool:
        """Return whether the contact sheet has no image yet."""
        return not self._tiles

    def __call__(self, view: StageView) -> None:
        """Add a step's output to the contact sheet."""
        if view.side is not None and view.name == "real":
            self._frame += 1
            self._step = 0
        if self._frame != self._wanted:
            return
        image = _to_bgr(view.work.reading)
        if image is None:
            return
        if view.side is None:
            self._tiles.append(_Tile(f"merge: {view.name}", image.copy()))
            self._zoom(image)
        elif view.name == view.side:
            self._tiles.append(_Tile(view.name, image.copy()))
        else:
            self._step += 1
            mask = view.work.mask
            self._edge = _edge_of(mask) or self._edge
            label = f"{self._step}. {view.name} ({view.side})"
            self._tiles.append(_Tile(label, _apply_mask(image, mask)))

    def draw(self) -> BgrImage:
        """Return the contact sheet (height, width, 3)."""
        tiles = [_draw_label(tile) for tile in self._tiles]
        height = max(tile.shape[0] for tile in tiles)
        rows = []
        for row in range(math.ceil(len(tiles) / _COLUMNS)):
            cells = [_pad_to(t, height) for t in tiles[row * _COLUMNS : (row + 1) * _COLUMNS]]
            while len(cells) < min(_COLUMNS, len(tiles)):
                cells.append(np.full((height, _TILE_PX, 3), 32, np.uint8))
            rows.append(np.hstack(cells))
        return np.vstack(rows).astype(np.uint8)

    def _zoom(self, image: BgrImage) -> None:
        """Add an enlarged edge of the mask to the contact sheet, to show halos and seams."""
        if self._edge is None:
            return
        row, column = self._edge
        high, wide = image.shape[0] // _ZOOM, image.shape[1] // _ZOOM
        top = int(np.clip(row - high // 2, 0, image.shape[0] - high))
        left = int(np.clip(column - wide // 2, 0, image.shape[1] - wide))
        cut = image[top : top + high, left : left + wide]
        near = cv2.resize(cut, None, fx=_ZOOM, fy=_ZOOM, interpolation=cv2.INTER_NEAREST)
        self._tiles.append(_Tile(f"edge, {_ZOOM} times", near.astype(np.uint8)))


def _to_bgr(reading: Reading) -> BgrImage | None:
    if isinstance(reading, CameraReading):
        return reading.image_bgr
    if isinstance(reading, DepthReading):
        return color_depth(reading.depth_m)
    return None


def _apply_mask(image: BgrImage, mask: Mask | None) -> BgrImage:
    """Return an image with a chequered background where its mask is off."""
    if mask is None:
        return image.copy()
    rows, columns = np.indices(mask.shape) // _SQUARE_PX
    squares = np.where((rows + columns) % 2 == 0, 96, 128).astype(np.uint8)
    return np.where(mask[:, :, None] > 0, image, squares[:, :, None]).astype(np.uint8)


def _edge_of(mask: Mask | None) -> tuple[int, int] | None:
    """Return row and column of a pixel on the upper edge of a mask; None without an edge."""
    if mask is None or not mask.any() or mask.all():
        return None
    columns = np.flatnonzero(mask.any(axis=0))
    column = int(columns[len(columns) // 4])
    return int(np.argmax(mask[:, column] > 0)), column


def _draw_label(tile: _Tile) -> BgrImage:
    height = round(tile.image_bgr.shape[0] * _TILE_PX / tile.image_bgr.shape[1])
    shrunk = tile.image_bgr.shape[1] > _TILE_PX
    how = cv2.INTER_AREA if shrunk else cv2.INTER_NEAREST
    image = cv2.resize(tile.image_bgr, (_TILE_PX, height), interpolation=how)
    strip = np.full((_LABEL_PX, _TILE_PX, 3), 32, np.uint8)
    cv2.putText(
        strip, tile.label, (6, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1, cv2.LINE_AA
    )
    return np.vstack([strip, image]).astype(np.uint8)


def _pad_to(tile: BgrImage, height: int) -> BgrImage:
    missing = height - tile.shape[0]
    framed: BgrImage = cv2.copyMakeBorder(
        tile, 0, missing, 0, 0, cv2.BORDER_CONSTANT, value=(32, 32, 32)
    )
    return framed
