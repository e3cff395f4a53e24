"""Array types of the kernels, and the groups of arrays that travel together through them.

Kernels take named tuples of arrays: Numba compiles these, unlike dataclasses.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wil_campaign.worlds.jit import F64

F32 = NDArray[np.float32]
I32 = NDArray[np.int32]
U32 = NDArray[np.uint32]
U8 = NDArray[np.uint8]


class GeometryArrays(NamedTuple):
    """The arrays of all triangles of a scene to render, each object in its own frame.

    vertices, normals: (n, 3). uv: (n, 2), repeats of the texture, above 0. faces: (m, 3).
    face_object, face_id, face_material: (m,); the id is the value in id images.
    vertex_range, face_range: (objects, 2), first and past the last.
    spheres: (objects, 4), bounding sphere in the object's frame: centre, radius.
    """

    vertices: F64
    normals: F64
    uv: F64
    faces: I32
    face_object: I32
    face_id: U8
    face_material: I32
    vertex_range: I32
    face_range: I32
    spheres: F64


class LookArrays(NamedTuple):
    """The colour arrays of a render. bgr: (materials,) packed 0x00rrggbb. texture: -1 for none.

    texels: all textures with their mip levels, packed. mip_start: (textures, levels).
    mip_count, log2_width, log2_height: (textures,). background: (512,) packed, from straight
    down over the horizon (256) to straight up.
    """

    bgr: U32
    texture: I32
    texels: U32
    mip_start: I32
    mip_count: I32
    log2_width: I32
    log2_height: I32
    background: U32


class ViewArrays(NamedTuple):
    """The arrays of one camera view. rotations: (objects, 3, 3), shifts: object to camera.

    lights: (objects, 2, 3), the lamp's and the upward direction in each object's frame.
    up: (3,) upwards in camera coordinates. shown: (objects,) 0 for what is left out.
    one_sided: (objects,) 1 for what is closed and seen from outside: its backs are hidden.
    """

    rotations: F64
    shifts: F64
    lights: F64
    up: F64
    shown: U8
    one_sided: U8
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int


class TriangleArrays(NamedTuple):
    """The arrays of triangles that may show, ready to be rendered.

    corners: (n, 6), x and y of three corners, 1/256 pixel. bounds: (n, 4), first and last column,
    first and last row with a pixel centre. planes: (n, 3), 1/z at pixel (0, 0), per column, per
    row. depth_range: (n, 2), least and greatest 1/z. face: (n,).
    """

    corners: I32
    bounds: I32
    planes: F64
    depth_range: F32
    face: I32


class ShadeArrays(NamedTuple):
    """The arrays of visible faces' shading; computed when a face is first needed.

    state: (m,), 0 unknown, else how to paint. shade: (m,), 0 to 256. planes: (m, 9), of shade,
    u and v over z: at pixel (0, 0), per column, per row.
    """

    state: U8
    shade: I32
    planes: F64


class VisibilityBuffer(NamedTuple):
    """The arrays of the visibility buffer: 1/z and triangle (-1 for none) of each pixel."""

    inverse_depth: F32
    triangle: I32
    width: int


class ScratchArrays(NamedTuple):
    """The working arrays of one frame. camera: (n, 3) vertices, screen: (n, 2) their pixels.

    colors: (pixels,), packed.
    """

    camera: F64
    screen: F64
    triangles: TriangleArrays
    shades: ShadeArrays
    buffer: VisibilityBuffer
    colors: U32
