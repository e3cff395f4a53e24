"""The renderer: images of one scene from any pose, from any thread.

A scene's meshes as the flat arrays that kernels read.
"""

import threading
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose, matrix_from_quat
from wil_campaign.worlds.jit import F64
from wil_campaign.worlds.render.arrays import (
    U32,
    GeometryArrays,
    LookArrays,
    ScratchArrays,
    ShadeArrays,
    TriangleArrays,
    ViewArrays,
    VisibilityBuffer,
)
from wil_campaign.worlds.render.placing import place_objects
from wil_campaign.worlds.render.rasterizer import gather_triangles, rasterize_triangles
from wil_campaign.worlds.render.shading import (
    clear_shading,
    shade_pixels,
    write_depth,
    write_ids,
    write_image,
)
from wil_campaign.worlds.scene.meshes import BgrTexture, Material, Mesh
from wil_campaign.worlds.scene.scene import NO_EVENTS, Scene

_WHITE = (255, 255, 255)
_SKY_HIGH, _SKY_LOW = (222, 176, 128), (238, 226, 212)
_GROUND_FAR, _GROUND_NEAR = (168, 176, 172), (96, 108, 104)


def pack_geometry(scene: Scene) -> GeometryArrays:
    """Pack all triangles of a scene into render arrays, each rigid body in its own frame."""
    bodies = scene.bodies
    shapes = [body.shape.mesh for body in bodies]
    vertex_range = _ranges([len(mesh.vertices_m) for mesh in shapes])
    face_range = _ranges([len(mesh.faces) for mesh in shapes])
    material_range = _ranges([len(mesh.materials) for mesh in shapes])
    objects = range(len(shapes))
    ids = np.array([body.scene_object.object_id for body in bodies], np.uint8)
    return GeometryArrays(
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


def pack_looks(scene: Scene) -> LookArrays:
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


def _looks(
    materials: Sequence[Material], texture: np.ndarray, levels: list[list[U32]]
) -> LookArrays:
    """Pack materials, their textures and mip levels into the render's colour arrays."""
    most = max((len(chain) for chain in levels), default=1)
    mip_start = np.zeros((max(1, len(levels)), most), np.int32)
    at = 0
    for index, chain in enumerate(levels):
        for level, texels in enumerate(chain):
            mip_start[index, level] = at
            at += texels.size
    flat = [texels.ravel() for chain in levels for texels in chain]
    return LookArrays(
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


@dataclass(frozen=True, slots=True, eq=False)
class RenderOutput:
    """A rendered image; its arrays belong to the caller.

    image_bgr: (height, width, 3) uint8. depth_m: (height, width) float32 metres along the
    optical axis, inf where nothing is. object_ids: (height, width) uint8, 0 where nothing is.
    depth_m and object_ids are None when they were not wanted. moving: the poses of the moving
    bodies that were drawn, in the order of the scene.
    """

    image_bgr: NDArray[np.uint8]
    depth_m: NDArray[np.float32] | None
    object_ids: NDArray[np.uint8] | None
    moving: tuple[Pose, ...] = ()


class Renderer:
    """Renders one scene. Several threads may call `render` at once; equal calls, equal bits."""

    def __init__(self, scene: Scene) -> None:
        self._bodies = scene.bodies
        self._geometry: GeometryArrays = pack_geometry(scene)
        self._looks: LookArrays = pack_looks(scene)
        self._local = threading.local()
        poses = [body.scene_object.pose for body in self._bodies]
        self._closed = np.array([body.shape.mesh.closed for body in self._bodies], np.uint8)
        self._moving = [
            (k, body) for k, body in enumerate(self._bodies) if body.scene_object.motion
        ]
        self._rotations = np.array([matrix_from_quat(pose.q_wxyz) for pose in poses])
        self._rotations = self._rotations.reshape(-1, 3, 3)
        self._positions_m = np.array([pose.position_ned_m for pose in poses]).reshape(-1, 3)

    def render(
        self,
        camera_pose: Pose,
        intrinsics: Intrinsics,
        t_s: float,
        events: Mapping[str, float] = NO_EVENTS,
        *,
        want_depth: bool = True,
        want_ids: bool = True,
        only: frozenset[str] | None = None,
        moving: tuple[Pose, ...] | None = None,
    ) -> RenderOutput:
        """Return the rendered image of a camera at a time.

        camera_pose: in the world (NED), FRD axes, x looks out. intrinsics: distortion is
        ignored. events: when each happened, for objects that move. only: names of the objects
        to draw; all others are absent, and hide nothing. moving: the poses of the moving bodies,
        as of an earlier image, instead of those at the time.
        """
        width, height = intrinsics.width_px, intrinsics.height_px
        if moving is None:
            moving = tuple(body.pose_at(t_s, events) for _, body in self._moving)
        view = self._view(camera_pose, intrinsics, moving, only)
        while (scratch := self._draw(view, self._scratch(width, height))) is None:
            self._local.triangles *= 2
        image = np.empty((height, width, 3), np.uint8)
        write_image(scratch.colors, image.reshape(-1))
        depth = np.empty((height, width), np.float32) if want_depth else None
        if depth is not None:
            write_depth(scratch.buffer.inverse_depth, depth.reshape(-1))
        ids = np.empty((height, width), np.uint8) if want_ids else None
        if ids is not None:
            owner, face = scratch.buffer.triangle, scratch.triangles.face
            write_ids(owner, face, self._geometry.face_id, ids.reshape(-1))
        return RenderOutput(image, depth, ids, moving)

    def _draw(self, view: ViewArrays, scratch: ScratchArrays) -> ScratchArrays | None:
        """Return the scratch with a frame rendered in it; None when it has too little room."""
        count = gather_triangles(self._geometry, view, scratch)
        if count < 0:
            return None
        triangles, buffer = scratch.triangles, scratch.buffer
        clear_shading(buffer.inverse_depth, buffer.triangle, scratch.shades.state)
        rasterize_triangles(
            triangles.corners,
            triangles.bounds,
            triangles.planes,
            triangles.depth_range,
            count,
            buffer,
        )
        shade_pixels(self._geometry, self._looks, view, scratch)
        return scratch

    def _view(
        self,
        camera_pose: Pose,
        intrinsics: Intrinsics,
        moving: tuple[Pose, ...],
        only: frozenset[str] | None,
    ) -> ViewArrays:
        rotations_ned, positions_ned_m = self._places(moving)
        view = ViewArrays(
            **self._view_arrays(),
            fx=float(intrinsics.fx_px),
            fy=float(intrinsics.fy_px),
            cx=float(intrinsics.cx_px),
            cy=float(intrinsics.cy_px),
            width=intrinsics.width_px,
            height=intrinsics.height_px,
        )
        view.one_sided[:] = self._closed
        # Floats: of other numbers Numba would make another kernel.
        q_wxyz = tuple(map(float, camera_pose.q_wxyz))
        at_ned_m = tuple(map(float, camera_pose.position_ned_m))
        place_objects(
            q_wxyz, at_ned_m, rotations_ned, positions_ned_m, self._geometry.spheres, view
        )
        if only is not None:
            names = [body.scene_object.name for body in self._bodies]
            view.shown[[name not in only for name in names]] = 0
        return view

    def _view_arrays(self) -> dict[str, Any]:
        """Return this thread's arrays for a view, which the next view of it overwrites."""
        local, count = self._local, len(self._bodies)
        if not hasattr(local, "view"):
            local.view = {
                "rotations": np.empty((count, 3, 3)),
                "shifts": np.empty((count, 3)),
                "lights": np.empty((count, 2, 3)),
                "up": np.empty(3),
                "shown": np.empty(count, np.uint8),
                "one_sided": np.empty(count, np.uint8),
            }
        arrays: dict[str, Any] = local.view
        return arrays

    def _places(self, moving: tuple[Pose, ...]) -> tuple[F64, F64]:
        """Return every rendered body's rotation (n, 3, 3) to NED and position (n, 3).

        Raises ValueError for another number of moving bodies.
        """
        if not self._moving and not moving:
            return self._rotations, self._positions_m
        rotations, positions_m = self._rotations.copy(), self._positions_m.copy()
        for (k, _), pose in zip(self._moving, moving, strict=True):
            rotations[k] = matrix_from_quat(pose.q_wxyz)
            positions_m[k] = pose.position_ned_m
        return rotations, positions_m

    def _scratch(self, width: int, height: int) -> ScratchArrays:
        """Return this thread's render work space, made anew for another image size."""
        local = self._local
        if not hasattr(local, "triangles"):
            local.triangles = len(self._geometry.faces) + 64
        key = (width, height, local.triangles)
        if getattr(local, "key", None) != key:
            local.key = key
            local.scratch = self._new_scratch(width, height, local.triangles)
        scratch: ScratchArrays = local.scratch
        return scratch

    def _new_scratch(self, width: int, height: int, triangles: int) -> ScratchArrays:
        vertices, faces = len(self._geometry.vertices), len(self._geometry.faces)
        return ScratchArrays(
            camera=np.empty((vertices, 3)),
            screen=np.empty((vertices, 2)),
            triangles=TriangleArrays(
                corners=np.empty((triangles, 6), np.int32),
                bounds=np.empty((triangles, 4), np.int32),
                planes=np.empty((triangles, 3)),
                depth_range=np.empty((triangles, 2), np.float32),
                face=np.empty(triangles, np.int32),
            ),
            shades=ShadeArrays(
                state=np.empty(faces, np.uint8),
                shade=np.empty(faces, np.int32),
                planes=np.empty((faces, 9)),
            ),
            buffer=VisibilityBuffer(
                inverse_depth=np.empty(height * width, np.float32),
                triangle=np.empty(height * width, np.int32),
                width=width,
            ),
            colors=np.empty(height * width, np.uint32),
        )
