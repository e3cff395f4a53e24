"""Triangle meshes, as cameras see them, in the object's own FRD frame, metres."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from wil_campaign.worlds.frames import Pose, Vec3, matrix_from_quat
from wil_campaign.worlds.scene.colors import Rgb

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]
BgrTexture = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Material:
    """A mesh surface's material: a colour, or a texture (height, width, 3) uint8 BGR.

    A texture repeats; its first row is at v = 0, and its colours are multiplied by `rgb`/255.
    """

    rgb: Rgb
    texture: BgrTexture | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles with smooth or flat normals; arrays are shared and never written to.

    vertices_m, normals: (n, 3) float64, FRD axes; normals are unit length and point outwards.
    uv: (n, 2) float64, in repeats of the texture. faces: (m, 3) int32, counter-clockwise seen
    from outside. face_material: (m,) int32, index into materials.
    closed: it consists of closed skins, so that from outside no back of a face can be seen.
    """

    vertices_m: FloatArray
    normals: FloatArray
    uv: FloatArray
    faces: IntArray
    face_material: IntArray
    materials: tuple[Material, ...]
    closed: bool = False

    @property
    def radius_m(self) -> float:
        """Return the radius of the sphere about the origin that holds every vertex of the mesh."""
        return float(np.sqrt((self.vertices_m**2).sum(axis=1).max()))

    def crc32(self, before: int = 0) -> int:
        """Return the CRC-32 of all that is drawn of the mesh, going on from that of others."""
        materials = [part for one in self.materials for part in (np.array(one.rgb), one.texture)]
        arrays = (self.vertices_m, self.normals, self.uv, self.faces, self.face_material)
        for array in (*arrays, *materials):
            if array is not None:
                before = crc32(np.ascontiguousarray(array).data, before)
        return before

    def moved(self, pose: Pose) -> "Mesh":
        """Return this mesh in the frame in which `pose` is given."""
        rotation = matrix_from_quat(pose.q_wxyz)
        return replace(
            self,
            vertices_m=self.vertices_m @ rotation.T + np.array(pose.position_ned_m),
            normals=self.normals @ rotation.T,
        )

    def painted(self, rgb: Rgb) -> "Mesh":
        """Return this mesh with every surface of one colour; textures stay."""
        return replace(self, materials=tuple(replace(m, rgb=rgb) for m in self.materials))

    def textured(self, texture: BgrTexture) -> "Mesh":
        """Return this mesh with one texture on every surface, in the texture's own colours."""
        return replace(
            self,
            materials=(Material((255, 255, 255), texture),),
            face_material=np.zeros_like(self.face_material),
        )


def merge_meshes(meshes: Sequence[Mesh]) -> Mesh:
    """Return several meshes merged into one."""
    faces, face_material = [], []
    vertex_count = material_count = 0
    for mesh in meshes:
        faces.append(mesh.faces + vertex_count)
        face_material.append(mesh.face_material + material_count)
        vertex_count += len(mesh.vertices_m)
        material_count += len(mesh.materials)
    return Mesh(
        vertices_m=np.concatenate([mesh.vertices_m for mesh in meshes]),
        normals=np.concatenate([mesh.normals for mesh in meshes]),
        uv=np.concatenate([mesh.uv for mesh in meshes]),
        faces=np.concatenate(faces).astype(np.int32),
        face_material=np.concatenate(face_material).astype(np.int32),
        materials=tuple(material for mesh in meshes for material in mesh.materials),
        closed=all(mesh.closed for mesh in meshes),
    )


def mesh_from_triangles(
    vertices_m: FloatArray, faces: NDArray[np.integer], material: Material
) -> Mesh:
    """Return a flat-shaded mesh of triangles, corners not shared; uv is zero."""
    corners = np.asarray(vertices_m, np.float64)[np.asarray(faces)]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0)
    count = len(corners)
    return Mesh(
        vertices_m=corners.reshape(-1, 3),
        normals=np.repeat(normals, 3, axis=0),
        uv=np.zeros((3 * count, 2)),
        faces=np.arange(3 * count, dtype=np.int32).reshape(-1, 3),
        face_material=np.zeros(count, np.int32),
        materials=(material,),
    )


def quad_mesh(
    center_m: Vec3,
    right_m: Vec3,
    up_m: Vec3,
    material: Material,
    repeats: tuple[float, float] = (1.0, 1.0),
) -> Mesh:
    """Return the mesh of a rectangle: centre, and half edges right and up as seen from it.

    A texture stands upright there, repeated so many times across and along.
    """
    center, right, up = np.array(center_m), np.array(right_m), np.array(up_m)
    across, along = repeats
    normal = np.cross(right, up)
    return Mesh(
        vertices_m=np.stack(
            [center - right - up, center + right - up, center + right + up, center - right + up]
        ),
        normals=np.tile(normal / np.linalg.norm(normal), (4, 1)),
        uv=np.array([[0.0, along], [across, along], [across, 0.0], [0.0, 0.0]]),
        faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        face_material=np.zeros(2, np.int32),
        materials=(material,),
    )


_UP: Vec3 = (0.0, 0.0, -1.0)
_FORWARD: Vec3 = (1.0, 0.0, 0.0)
_SIDES: tuple[tuple[Vec3, Vec3], ...] = (
    ((1.0, 0.0, 0.0), _UP),
    ((-1.0, 0.0, 0.0), _UP),
    ((0.0, 1.0, 0.0), _UP),
    ((0.0, -1.0, 0.0), _UP),
    ((0.0, 0.0, 1.0), _FORWARD),
    ((0.0, 0.0, -1.0), _FORWARD),
)
"""Outward normal and upward edge of each side of a box."""


def box_mesh(size_m: Vec3, material: Material) -> Mesh:
    """Return the mesh of a box centred on the origin; each side one texture."""
    half = np.array(size_m) / 2.0
    sides = []
    for normal, up in _SIDES:
        right = np.cross(np.array(up), np.array(normal))
        center, across, along = (vec3(np.array(edge) * half) for edge in (normal, right, up))
        sides.append(quad_mesh(center, across, along, material))
    return replace(
        merge_meshes(sides),
        materials=(material,),
        face_material=np.zeros(12, np.int32),
        closed=True,
    )


def vec3(array: FloatArray) -> Vec3:
    """Return an array of three numbers as a vector."""
    return (float(array[0]), float(array[1]), float(array[2]))


def ellipsoid_mesh(
    radii_m: tuple[float, float, float], material: Material, *, slices: int = 16, stacks: int = 10
) -> Mesh:
    """Return the smooth mesh of an ellipsoid centred on the origin, its poles on the down axis."""
    polar, around = np.meshgrid(
        np.linspace(0.0, np.pi, stacks + 1),
        np.linspace(0.0, 2.0 * np.pi, slices + 1),
        indexing="ij",
    )
    unit = np.stack(
        [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), -np.cos(polar)], axis=-1
    ).reshape(-1, 3)
    uv = np.stack([around / (2.0 * np.pi), polar / np.pi], axis=-1).reshape(-1, 2)
    skin = _lathe_mesh(
        unit * np.array(radii_m),
        unit / np.array(radii_m),
        uv,
        rings=(slices, stacks),
        material=material,
    )
    return replace(skin, closed=True)


def frustum_mesh(
    radius_top_m: float,
    radius_bottom_m: float,
    height_m: float,
    material: Material,
    *,
    slices: int = 14,
    flatten: float = 1.0,
) -> Mesh:
    """Return the mesh of an upright (down axis) closed cone frustum centred on the origin.

    flatten: the radius along forward in parts of the radius along right.
    """
    around = np.linspace(0.0, 2.0 * np.pi, slices + 1)
    ring = np.stack([flatten * np.cos(around), np.sin(around), np.zeros_like(around)], axis=-1)
    half = np.array([0.0, 0.0, height_m / 2.0])
    top, bottom = ring * radius_top_m - half, ring * radius_bottom_m + half
    slope = (radius_bottom_m - radius_top_m) / height_m
    normals = np.stack(
        [np.cos(around) / flatten, np.sin(around), np.full_like(around, -slope)], axis=-1
    )
    u = around / (2.0 * np.pi)
    uv = np.concatenate([np.stack([u, 0.0 * u], -1), np.stack([u, 0.0 * u + 1.0], -1)])
    side = _lathe_mesh(
        np.concatenate([top, bottom]),
        np.concatenate([normals, normals]),
        uv,
        rings=(slices, 1),
        material=material,
    )
    index = np.arange(1, slices - 1)
    fan = np.stack([np.zeros_like(index), index, index + 1], axis=-1)
    caps = [
        mesh_from_triangles(bottom, fan, material),
        mesh_from_triangles(top, fan[:, ::-1], material),
    ]
    return replace(merge_meshes([side, *caps]), closed=True)


def _lathe_mesh(
    vertices: FloatArray,
    normals: FloatArray,
    uv: FloatArray,
    *,
    rings: tuple[int, int],
    material: Material,
) -> Mesh:
    """Return the mesh over a grid of rings from top to bottom; rings: slices and stacks."""
    slices, stacks = rings
    first = (np.arange(stacks)[:, None] * (slices + 1) + np.arange(slices)[None, :]).ravel()
    below = first + slices + 1
    faces = np.concatenate(
        [np.stack([first, first + 1, below + 1], -1), np.stack([first, below + 1, below], -1)]
    ).astype(np.int32)
    return Mesh(
        vertices_m=vertices,
        normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
        uv=uv,
        faces=faces,
        face_material=np.zeros(len(faces), np.int32),
        materials=(material,),
    )
