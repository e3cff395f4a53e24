"""Array types of the kernels, and the groups of arrays that travel together through them.

Kernels take named tuples of arrays: Numba compiles these, unlike dataclasses.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
F32 = NDArray[np.float32]
I32 = NDArray[np.int32]
U32 = NDArray[np.uint32]
U8 = NDArray[np.uint8]


class Geometry(NamedTuple):
    """All triangles of a scene, each object in its own frame.

    vertices, normals: (n, 3). uv: (n, 2), repeats of the texture, above 0. faces: (m, 3).
    face_object, face_material: (m,). vertex_range, face_range: (objects, 2), first and past
    the last. spheres: (objects, 4), bounding sphere in the object's frame: centre, radius.
    """

    vertices: F64
    normals: F64
    uv: F64
    faces: I32
    face_object: I32
    face_material: I32
    vertex_range: I32
    face_range: I32
    spheres: F64


class Looks(NamedTuple):
    """Colours. bgr: (materials,) packed 0x00rrggbb. texture: (materials,), -1 for none.

    texels: all textures with their mip levels, packed. mip_start: (textures, levels).
    mip_count, log2_width, log2_height: (textures,). background: (512,) packed, from straight
    down over the horizon (256) to straight up. object_ids: (objects,).
    """

    bgr: U32
    texture: I32
    texels: U32
    mip_start: I32
    mip_count: I32
    log2_width: I32
    log2_height: I32
    background: U32
    object_ids: U8


class View(NamedTuple):
    """One camera. rotations: (objects, 3, 3), shifts: (objects, 3): object to camera.

    lights: (objects, 2, 3), the lamp's and the upward direction in each object's frame.
    up: (3,) upwards in camera coordinates. shown: (objects,) 0 for what is left out.
    """

    rotations: F64
    shifts: F64
    lights: F64
    up: F64
    shown: U8
    fx: float
    fy: float
    cx: float
    cy: float


class Scratch(NamedTuple):
    """What one frame is worked out in; sizes from the scene and the picture.

    camera: (n, 3) vertices. screen: (n, 2) pixels. corners: (t, 6) int32, 1/256 pixel.
    planes: (t, 3) of 1/z. depth_range: (t, 2) least and greatest 1/z. triangle_face: (t,).
    attributes: (m, 9), planes of shade, u, v over z. face_state: (m,), 0 unknown, else how to
    shade. face_shade: (m,). inverse_depth, triangle: (rows of a band, width).
    """

    camera: F64
    screen: F64
    corners: I32
    planes: F64
    depth_range: F32
    triangle_face: I32
    attributes: F64
    face_state: U8
    face_shade: I32
    inverse_depth: F32
    triangle: I32


class Run(NamedTuple):
    """What varies along a run of pixels: each over z at its first pixel, per column, per row."""

    w: float
    w_step: float
    w_down: float
    shade: float
    shade_step: float
    u: float
    u_step: float
    u_down: float
    v: float
    v_step: float
    v_down: float


class Target(NamedTuple):
    """Where the picture goes. depth and ids have one element when they are not wanted."""

    image: U8
    depth: F32
    ids: U8
    want_depth: bool
    want_ids: bool
