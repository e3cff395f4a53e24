"""Meshes from files: .obj, .stl, .glb, .gltf, .dae, .ply through trimesh, imported when needed."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from worlds.colors import Rgb
from worlds.frames import Pose
from worlds.meshes import FloatArray, Material, Mesh, merge
from worlds.parts import Part, SurfaceShape
from worlds.shapes import Shape
from worlds.textures import to_powers_of_two

Unit = Literal["m", "cm", "mm", "in", "ft"]
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]

METRES: dict[Unit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
SUFFIXES = (".obj", ".stl", ".glb", ".gltf", ".dae", ".ply")
MAX_FACES = 500_000
_PLAIN_RGB: Rgb = (150, 150, 150)


class MeshFileError(Exception):
    """A mesh file that cannot be used, and why."""


@dataclass(frozen=True, slots=True)
class Axes:
    """Which axes of the file point up and forward."""

    up: Axis
    forward: Axis

    def frd_from_file(self) -> FloatArray:
        """Return the matrix that turns the file's axes into forward, right, down."""
        forward, up = _unit(self.forward), _unit(self.up)
        return np.stack([forward, np.cross(forward, up), -up])


Y_UP = Axes("y", "z")
"""glTF 2.0, section 3.4: +Y up, +Z forward; Collada's default is Y up as well."""
Z_UP = Axes("z", "x")
"""REP 103: x forward, z up."""


def _unit(axis: Axis) -> FloatArray:
    vector = np.zeros(3)
    vector["xyz".index(axis[-1])] = -1.0 if axis.startswith("-") else 1.0
    return vector


def default_axes(path: Path) -> Axes:
    """Return the custom of a file's format."""
    return Y_UP if path.suffix.lower() in (".glb", ".gltf", ".dae") else Z_UP


def load_mesh_shape(
    path: Path, *, unit: Unit = "m", scale: float = 1.0, axes: Axes | None = None
) -> Shape:
    """Return the thing in a mesh file; its surface is what can be touched.

    Raises MeshFileError with the reason when the file is missing, of no known kind, not a mesh,
    empty, not finite, or has more than MAX_FACES faces.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise MeshFileError(f"'{path.suffix}' is none of {', '.join(SUFFIXES)}")
    if not path.is_file():
        raise MeshFileError("no such file")
    turn = (axes or default_axes(path)).frd_from_file() * (METRES[unit] * scale)
    meshes = [_converted(part, turn) for part in _loaded(path)]
    meshes = [mesh for mesh in meshes if len(mesh.faces)]
    if not meshes:
        raise MeshFileError("there are no triangles in it")
    mesh = merge(meshes)
    if len(mesh.faces) > MAX_FACES:
        raise MeshFileError(f"{len(mesh.faces)} faces are more than {MAX_FACES}")
    if not np.isfinite(mesh.vertices_m).all():
        raise MeshFileError("it has coordinates that are not finite")
    surface = SurfaceShape(mesh.vertices_m, mesh.faces)
    return Shape("mesh", mesh, (Part("surface", surface, Pose((0.0, 0.0, 0.0))),))


def _loaded(path: Path) -> list[Any]:
    """Return the triangle meshes of a file with their places in its scene applied."""
    # Half a second that only worlds with mesh files pay.
    import trimesh  # noqa: PLC0415

    try:
        scene = trimesh.load_scene(str(path), process=False)
        dumped = scene.dump()
    except Exception as error:
        # The readers behind trimesh raise whatever a broken file makes them stumble over.
        raise MeshFileError(f"cannot be read as a mesh: {error or type(error).__name__}") from error
    return [part for part in dumped if isinstance(part, trimesh.Trimesh)]


def _converted(part: Any, turn: FloatArray) -> Mesh:
    """Return a mesh of trimesh in FRD metres."""
    vertices = np.asarray(part.vertices, np.float64) @ turn.T
    faces = np.ascontiguousarray(part.faces, np.int32)
    normals = _normals(vertices, faces)
    uv = getattr(part.visual, "uv", None)
    uv = np.zeros((len(vertices), 2)) if uv is None or len(uv) != len(vertices) else np.array(uv)
    # Files count v upwards from the picture's last row, we downwards from its first.
    uv = np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1)
    return Mesh(vertices, normals, uv, faces, np.zeros(len(faces), np.int32), (_material(part),))


def _normals(vertices: FloatArray, faces: np.ndarray) -> FloatArray:
    """Return smooth normals: the sum of the faces' own, weighted by area."""
    corners = vertices[faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(total, faces[:, corner], flat)
    lengths = np.linalg.norm(total, axis=1, keepdims=True)
    unit = np.divide(total, lengths, out=np.zeros_like(total), where=lengths > 0.0)
    return np.asarray(unit)


def _material(part: Any) -> Material:
    material = getattr(part.visual, "material", None)
    picture = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if picture is not None:
        rgb = np.asarray(picture.convert("RGB"), np.uint8)
        return Material((255, 255, 255), to_powers_of_two(np.ascontiguousarray(rgb[:, :, ::-1])))
    color = getattr(material, "main_color", None)
    if color is None:
        return Material(_PLAIN_RGB)
    return Material((int(color[0]), int(color[1]), int(color[2])))
