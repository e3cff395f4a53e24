"""The rasteriser: triangles to a visibility buffer, exactly and deterministically.

A visibility buffer (Burns and Hunt 2013) holds 1/z and the triangle of each pixel; colour is
looked up once per pixel, afterwards (shading.py). Coverage is solved in integers of 1/256 pixel
with the top-left rule, so that neighbours share no pixel and leave none out. Planes of 1/z come
from unclipped triangles in homogeneous coordinates (Olano and Greer 1997).

Camera coordinates are optical: x right, y down, z forward, metres. Pixel centres are integers.
"""

import numpy as np

from worlds.meshes import FloatArray
from worlds.render.arrays import F32, F64, I32, I64
from worlds.render.jit import compiled

NEAR_M = 0.05
SUB = 256
GUARD_PX = 1_000_000.0
"""Triangles reach at most so far from the picture: their products then fit 64 bits."""


@compiled
def object_visible(center: F64, radius: float, view: F64, width: int, height: int) -> bool:
    """Return whether a sphere (camera coordinates) may show. view: fx, fy, cx, cy."""
    fx, fy, cx, cy = view[0], view[1], view[2], view[3]
    x, y, z = center[0], center[1], center[2]
    if z + radius <= NEAR_M:
        return False
    left, right = cx + 0.5, width - 0.5 - cx
    top, bottom = cy + 0.5, height - 0.5 - cy
    return (
        fx * x + left * z > -radius * np.sqrt(fx * fx + left * left)
        and right * z - fx * x > -radius * np.sqrt(fx * fx + right * right)
        and fy * y + top * z > -radius * np.sqrt(fy * fy + top * top)
        and bottom * z - fy * y > -radius * np.sqrt(fy * fy + bottom * bottom)
    )


@compiled
def transform(vertices: F64, first: int, last: int, rotation: F64, shift: F64, out: F64) -> None:
    """Write vertices[first:last] turned and shifted into camera coordinates."""
    for i in range(first, last):
        x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        out[i, 0] = rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z + shift[0]
        out[i, 1] = rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z + shift[1]
        out[i, 2] = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z + shift[2]
