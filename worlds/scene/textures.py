"""Textures of surfaces: generated from a seed, or loaded from image files.

Generated textures have structure on several scales, so that a camera sees motion, and muted
colours, so that colour detectors are not misled.
"""

import math
from pathlib import Path

import cv2
import numpy as np

from wil_campaign.foundation.files.images import read_image
from wil_campaign.worlds.scene.meshes import BgrTexture, FloatArray

SIDE_PX = 256
_LARGEST_SIDE_PX = 2048


def _clouds(rng: np.random.Generator, octaves: tuple[int, ...]) -> FloatArray:
    """Return smooth periodic noise about 0 for textures; octaves: cells per side."""
    total = np.zeros((SIDE_PX, SIDE_PX))
    for cells in octaves:
        coarse = rng.standard_normal((cells, cells))
        wrapped = np.pad(coarse, 2, mode="wrap")
        size = SIDE_PX * (cells + 4) // cells
        fine = cv2.resize(wrapped, (size, size), interpolation=cv2.INTER_CUBIC)
        start = (size - SIDE_PX) // 2
        total += fine[start : start + SIDE_PX, start : start + SIDE_PX] / np.sqrt(cells)
    return np.asarray(total / total.std())


def _paint(base_bgr: tuple[int, int, int], relief: FloatArray) -> BgrTexture:
    """Return a texture: a base colour lightened and darkened by a relief in grey levels."""
    return np.clip(np.array(base_bgr) + relief[:, :, None], 0, 255).astype(np.uint8)


def concrete_texture(seed: int, base_bgr: tuple[int, int, int]) -> BgrTexture:
    """Return the texture of a poured wall: stains, and the joints and holes of its formwork."""
    rng = np.random.default_rng(seed)
    relief = 7.0 * _clouds(rng, (4, 8, 16)) + 3.0 * _clouds(rng, (64,))
    relief[:: SIDE_PX // 2] -= 26.0
    relief[:, :: SIDE_PX // 2] -= 26.0
    texture = _paint(base_bgr, relief)
    for row in (SIDE_PX // 8, SIDE_PX * 3 // 8, SIDE_PX * 5 // 8, SIDE_PX * 7 // 8):
        for column in (SIDE_PX // 8, SIDE_PX * 3 // 8, SIDE_PX * 5 // 8, SIDE_PX * 7 // 8):
            shade = tuple(int(part) - 45 for part in texture[row, column])
            cv2.circle(texture, (column, row), 3, shade, -1)
    return texture


def block_texture(seed: int, base_bgr: tuple[int, int, int]) -> BgrTexture:
    """Return the texture of a wall of painted blocks with mortar between."""
    rng = np.random.default_rng(seed)
    relief = 3.0 * _clouds(rng, (8, 32))
    rows, columns = 8, 4
    height, width = SIDE_PX // rows, SIDE_PX // columns
    for row in range(rows):
        for column in range(columns):
            top, left = row * height, column * width + (row % 2) * width // 2
            block = np.ix_(np.arange(top, top + height), np.arange(left, left + width) % SIDE_PX)
            relief[block] += rng.normal(0.0, 7.0)
        joints = np.arange(columns) * width + (row % 2) * width // 2
        relief[top : top + height, joints] -= 24.0
        relief[top : top + 2] -= 24.0
    return _paint(base_bgr, relief)


def tile_texture(seed: int, base_bgr: tuple[int, int, int]) -> BgrTexture:
    """Return the texture of a floor of square mats in two shades, speckled."""
    rng = np.random.default_rng(seed)
    half = SIDE_PX // 2
    rows, columns = np.indices((SIDE_PX, SIDE_PX)) // half
    relief = 5.0 * _clouds(rng, (8, 32)) + np.where((rows + columns) % 2, 9.0, -9.0)
    speckles = rng.integers(0, SIDE_PX, (2, 300))
    relief[speckles[0], speckles[1]] += rng.normal(0.0, 22.0, 300)
    relief[::half] -= 20.0
    relief[:, ::half] -= 20.0
    return _paint(base_bgr, relief)


def panel_texture(seed: int, base_bgr: tuple[int, int, int]) -> BgrTexture:
    """Return the texture of a ceiling of light panels with dark seams."""
    rng = np.random.default_rng(seed)
    relief = 2.0 * _clouds(rng, (16, 64))
    relief[:: SIDE_PX // 4] -= 30.0
    relief[:, :: SIDE_PX // 2] -= 30.0
    return _paint(base_bgr, relief)


def load_texture(path: Path) -> BgrTexture:
    """Return the texture in an image file, its sides brought to powers of two.

    Raises ValueError when there is no image in the file, OSError when it cannot be read.
    """
    return texture_to_powers_of_two(np.asarray(read_image(path), np.uint8))


def texture_to_powers_of_two(image: BgrTexture) -> BgrTexture:
    """Return a texture with each side at the nearest power of two, at most 2048."""
    height, width = (_power_of_two(side) for side in image.shape[:2])
    if (height, width) == image.shape[:2]:
        return np.ascontiguousarray(image)
    resized = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(resized, np.uint8)


def _power_of_two(side_px: int) -> int:
    """Return the power of two nearest to a texture's side, at most the largest."""
    return min(_LARGEST_SIDE_PX, 1 << round(math.log2(side_px)))
