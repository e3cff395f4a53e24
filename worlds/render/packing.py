"""A scene's meshes as the flat arrays that kernels read."""

from collections.abc import Iterable, Sequence

import cv2
import numpy as np

from wil_campaign.worlds.jit import F64
from wil_campaign.worlds.render.arrays import U32, Geometry, Looks
from wil_campaign.worlds.scene.meshes import BgrTexture, Material, Mesh
from wil_campaign.worlds.scene.scene import Scene

_WHITE = (255, 255, 255)
_SKY_HIGH, _SKY_LOW = (222, 176, 128), (238, 226, 212)
_GROUND_FAR, _GROUND_NEAR = (168, 176, 172), (96, 108, 104)


def pack_geometry(scene: Scene) -> Geometry:
    """Pack all triangles of a scene into render arrays, each rigid body in its own frame."""
    bodies = scene.bodies
    shapes = [body.shape.mesh for body in bodies]
    vertex_range = _ranges([len(mesh.vertices_m) for mesh in shapes])
    face_range = _ranges([len(mesh.faces) for mesh in shapes])
    material_range = _ranges([len(mesh.materials) for mesh in shapes])
    objects = range(len(shapes))
    ids = np.array([body.scene_object.object_id for body in bodies], np.uint8)
    return Geometry(
        vertices=_stack([mesh.vertices_m for mesh in shapes], 3, np.float64),
        normals=_stack([mesh.normals for mesh in shapes], 3, np.float64),
        uv=_stack([_above_zero(mesh.uv) for mesh in shapes], 2, np.float64),
        faces=_stack([shapes[k].faces + vertex_range[k, 0] for k in objects], 3, np.int32),
        face_object=np.repeat(np.arange(len(shapes), dtype=np.int32), np.diff(face_range).ravel()),
        face_id=np.repeat(ids, np.diff(face_range).ravel()),
        face_material=_stack(
            [shapes[k].face_material + material_range[k, 0] for k in objects], 0, np.int32
        ),
        vertex_range=vertex_range,
        face_range=face_range,
        spheres=_stack([bounding_sphere(mesh)[None] for mesh in shapes], 4, np.float64),
    )


def bounding_sphere(mesh: Mesh) -> F64:
    """Return (x, y, z, radius) of a sphere that holds a mesh, about the middle of its extent."""
    middle = (mesh.vertices_m.min(axis=0) + mesh.vertices_m.max(axis=0)) / 2.0
    radius = np.sqrt(((mesh.vertices_m - middle) ** 2).sum(axis=1).max())
    return np.append(middle, radius)


def pack_looks(scene: Scene) -> Looks:
    """Pack colours and textures of a scene into render arrays; equal textures once."""
    materials = [material for body in scene.bodies for material in body.shape.mesh.materials]
    levels: list[list[U32]] = []
    places: dict[tuple[int, tuple[int, int, int]], int] = {}
    texture = np.full(len(materials), -1, np.int32)
    for index, material in enumerate(materials):
        if material.texture is None:
            continue
        key = (id(material.texture), material.rgb)
        if key not in places:
            places[key] = len(levels)
            levels.append(_mip_levels(material.texture, material))
        texture[index] = places[key]
    return _looks(materials, texture, levels)


def _looks(materials: Sequence[Material], texture: np.ndarray, levels: list[list[U32]]) -> Looks:
    """Pack materials, their textures and mip levels into the render's colour arrays."""
    most = max((len(chain) for chain in levels), default=1)
    mip_start = np.zeros((max(1, len(levels)), most), np.int32)
    at = 0
    for index, chain in enumerate(levels):
        for level, texels in enumerate(chain):
            mip_start[index, level] = at
            at += texels.size
    flat = [texels.ravel() for chain in levels for texels in chain]
    return Looks(
        bgr=np.array([_pack(m.rgb[::-1]) for m in materials], np.uint32),
        texture=texture,
        texels=np.concatenate(flat) if flat else np.zeros(1, np.uint32),
        mip_start=mip_start,
        mip_count=_per_texture(len(chain) for chain in levels),
        log2_width=_per_texture(chain[0].shape[1].bit_length() - 1 for chain in levels),
        log2_height=_per_texture(chain[0].shape[0].bit_length() - 1 for chain in levels),
        background=_background(),
    )


def _per_texture(values: Iterable[int]) -> np.ndarray:
    """Pack one number per texture into an array, never empty."""
    listed = list(values)
    return np.array(listed or [0], np.int32)


def _mip_levels(texture: BgrTexture, material: Material) -> list[U32]:
    """Return the packed texture's mip levels: tinted, and halved until one texel is left."""
    height, width = texture.shape[:2]
    if height & (height - 1) or width & (width - 1):
        raise ValueError(f"texture of {width} x {height}: sides must be powers of two")
    level = texture
    if material.rgb != _WHITE:
        tint = np.array(material.rgb[::-1], np.float64) / 255.0
        level = np.round(texture * tint).astype(np.uint8)
    chain = [_packed_texels(level)]
    while max(level.shape[:2]) > 1:
        size = (max(1, level.shape[1] // 2), max(1, level.shape[0] // 2))
        level = np.asarray(cv2.resize(level, size, interpolation=cv2.INTER_AREA), np.uint8)
        chain.append(_packed_texels(level))
    return chain


def _packed_texels(bgr: BgrTexture) -> U32:
    wide = bgr.astype(np.uint32)
    packed = wide[:, :, 0] | wide[:, :, 1] << 8 | wide[:, :, 2] << 16
    return packed.astype(np.uint32)


def _pack(bgr: Sequence[int]) -> int:
    return bgr[0] | bgr[1] << 8 | bgr[2] << 16


def _background() -> U32:
    """Return the packed background: 512 colours from straight down over the horizon to up."""
    ground = np.linspace(_GROUND_NEAR, _GROUND_FAR, 256)
    sky = np.linspace(_SKY_LOW, _SKY_HIGH, 256)
    colors = np.round(np.concatenate([ground, sky])).astype(np.uint8)
    return _packed_texels(colors[None]).ravel()


def _above_zero(uv: F64) -> F64:
    """Return texture coordinates moved by whole repeats to be positive, for packing."""
    return np.asarray(uv - np.floor(uv.min(axis=0)) + 1.0)


def _ranges(counts: Sequence[int]) -> np.ndarray:
    """Return (begin, end) of consecutive packed ranges of these counts."""
    ends = np.cumsum([0, *counts])
    return np.stack([ends[:-1], ends[1:]], axis=1).astype(np.int32)


def _stack(arrays: Sequence[np.ndarray], columns: int, dtype: type) -> np.ndarray:
    if not arrays:
        return np.zeros((0, columns) if columns else 0, dtype)
    return np.ascontiguousarray(np.concatenate(arrays), dtype)
