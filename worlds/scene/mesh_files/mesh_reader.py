"""Meshes from files: .obj, .stl, .glb, .gltf, .dae, .ply through trimesh, imported when needed."""

import math
import re
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import numpy as np

from worlds.files.images import ImageError, check_pixels
from worlds.files.limits import MAX_MESH_BYTES, MAX_MESH_FACES
from worlds.files.paths import is_file
from worlds.frames import Pose
from worlds.scene.colors import SRGB_OF_LINEAR, Rgb
from worlds.scene.mesh_files.mesh_damage import damage
from worlds.scene.mesh_files.mesh_limits import MeshLimitError, check_mesh_file
from worlds.scene.mesh_files.mesh_polygons import check_polygons, ply_polygons
from worlds.scene.mesh_files.mesh_support import UnsupportedMeshError
from worlds.scene.mesh_files.obj_faces import obj_with_absolute_faces
from worlds.scene.meshes import FloatArray, IntArray, Material, Mesh, merge
from worlds.scene.parts import Part, SurfaceShape
from worlds.scene.shapes import Shape
from worlds.scene.smoothing import smoothed
from worlds.scene.textures import to_powers_of_two

Unit = Literal["m", "cm", "mm", "in", "ft"]
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]

METRES: dict[Unit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
SUFFIXES = (".obj", ".stl", ".glb", ".gltf", ".dae", ".ply")
MAX_FACES = MAX_MESH_FACES
_PLAIN_RGB: Rgb = (150, 150, 150)
_MOST_COLORS = 64
_FARTHEST = 1e9
"""Of a coordinate in the file's own unit: a thousand kilometres of millimetres."""
_WHITE: Rgb = (255, 255, 255)
_LINEAR_COLORS = (".glb", ".gltf")
"""Formats whose colours are linear (glTF 2.0, 3.9.2 and 3.7.2.1); their textures are sRGB."""
_NO_AREA = 1e-12
"""Of the square of the longest edge: what is left of no area after rounding."""


class MeshFileError(Exception):
    """A mesh file that cannot be used, and why."""


@dataclass(frozen=True, slots=True)
class Axes:
    """Which axes of a mesh file point up and forward."""

    up: Axis
    forward: Axis

    def frd_from_file(self) -> FloatArray:
        """Return the matrix from a mesh file's axes to forward, right, down."""
        forward, up = _unit(self.forward), _unit(self.up)
        return np.stack([forward, np.cross(forward, up), -up])


Y_UP = Axes("y", "z")
"""glTF 2.0, section 3.4: +Y up, +Z forward; Collada's default is Y up as well."""
Z_UP = Axes("z", "x")
"""REP 103: x forward, z up."""


def _unit(axis: Axis) -> FloatArray:
    """Return the unit vector of a mesh file's axis name ("-y")."""
    vector = np.zeros(3)
    vector["xyz".index(axis[-1])] = -1.0 if axis.startswith("-") else 1.0
    return vector


def default_axes(path: Path, asset: "Asset") -> Axes:
    """Return the axes that a mesh file states, else the custom of its format."""
    if asset.up_axis is not None:
        return asset.up_axis
    return Y_UP if path.suffix.lower() in (".glb", ".gltf", ".dae") else Z_UP


@dataclass(frozen=True, slots=True)
class Asset:
    """A mesh file's own statements: metres per unit, and its axes. Only Collada has them."""

    unit_m: float = 1.0
    up_axis: Axes | None = None


_COLLADA_AXES = {"X_UP": Axes("x", "z"), "Y_UP": Y_UP, "Z_UP": Z_UP}


def read_asset(path: Path) -> Asset:
    """Return the unit and axes that a Collada mesh file states (1.4.1, chapter 5, "asset").

    Raises MeshFileError for a unit that is no length.
    """
    if path.suffix.lower() != ".dae":
        return Asset()
    with path.open("rb") as stream:
        text = stream.read(100_000).decode("utf-8", "replace")
    unit = re.search(r"<unit\b[^>]*\bmeter\s*=\s*[\"']([^\"']*)[\"']", text)
    axes = re.search(r"<up_axis>\s*([XYZ]_UP)\s*</up_axis>", text)
    unit_m = _metres(unit[1]) if unit else 1.0
    return Asset(unit_m, _COLLADA_AXES[axes[1]] if axes else None)


def _metres(written: str) -> float:
    """Return a Collada file's unit in metres. Raises MeshFileError for one that is no length."""
    try:
        unit_m = float(written)
    except ValueError:
        unit_m = math.nan
    if not 0.0 < unit_m <= _FARTHEST:
        raise MeshFileError(f'its unit, meter="{written[:40]}", is not a length in metres')
    return unit_m


def load_mesh_shape(
    path: Path, *, unit: Unit | None = None, scale: float = 1.0, axes: Axes | None = None
) -> Shape:
    """Return the shape in a mesh file; its surface is what can be touched.

    unit, axes: None for what the file states, else for metres and for its format's custom.
    Raises MeshFileError with the reason when the file is missing, of no known kind, not a mesh,
    empty, not finite, or has more than MAX_FACES faces, when a file that it names is missing, and
    when it has what its reader would leave out or misread.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise MeshFileError(f"'{path.suffix}' is not one of {', '.join(SUFFIXES)}")
    if not is_file(path):
        raise MeshFileError("no such file")
    try:
        check_mesh_file(path)
    except (MeshLimitError, UnsupportedMeshError) as error:
        raise MeshFileError(str(error)) from error
    loaded = _load(path)
    if sum(len(part.faces) for part in loaded) > MAX_FACES:
        raise MeshFileError(f"it has more than {MAX_FACES} faces")
    asset = read_asset(path)
    turn = (axes or default_axes(path, asset)).frd_from_file()
    turn = turn * (scale * (METRES[unit] if unit else asset.unit_m))
    is_linear = path.suffix.lower() in _LINEAR_COLORS
    meshes = [_convert(part, turn, is_linear=is_linear) for part in loaded if len(part.faces)]
    if not meshes:
        why = damage(path)
        raise MeshFileError(f"it has no triangles{': ' if why else ''}{why}")
    mesh = merge(meshes)
    _check_area(mesh)
    surface = SurfaceShape(mesh.vertices_m, mesh.faces)
    return Shape("mesh", mesh, (Part("surface", surface, Pose((0.0, 0.0, 0.0))),))


def _load(path: Path) -> list[Any]:
    """Return the triangle meshes of a mesh file, their places in its scene applied."""
    # Half a second that only worlds with mesh files pay.
    import trimesh  # noqa: PLC0415

    _check_companions(path)
    try:
        scene = _open(path, trimesh)
        dumped = scene.dump()
    except UnsupportedMeshError as error:
        raise MeshFileError(str(error)) from error
    except Exception as error:
        # The readers behind trimesh raise any exception for a damaged file, with messages about
        # their internals.
        why = damage(path) or "it is damaged, or its format does not match its suffix"
        raise MeshFileError(f"cannot be read as a mesh: {why}") from error
    parts = [part for part in dumped if isinstance(part, trimesh.Trimesh)]
    for part in parts:
        _check_part(part)
    return parts


def _open(path: Path, trimesh: Any) -> Any:
    """Return the scene of a mesh file. Raises UnsupportedMeshError for faces that it misreads."""
    if path.suffix.lower() == ".obj":
        text, beside = obj_with_absolute_faces(path), trimesh.resolvers.FilePathResolver(str(path))
        return trimesh.load_scene(BytesIO(text), file_type="obj", resolver=beside, process=False)
    scene = trimesh.load_scene(str(path), process=False)
    for part in scene.geometry.values():
        polygons = ply_polygons(part.metadata.pop("_ply_raw", {}))
        if polygons is not None:
            check_polygons(polygons)
    return scene


def _check_area(mesh: Mesh) -> None:
    """Refuse a mesh that nothing can see or touch: compressed data that were read as zeros."""
    corners = mesh.vertices_m[mesh.faces]
    edges = corners[:, 1:] - corners[:, :1]
    twice_area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    if twice_area.max() <= _NO_AREA * np.abs(edges).max() ** 2:
        raise MeshFileError(f"none of its {len(mesh.faces)} triangles has an area")


def _check_part(part: Any) -> None:
    """Refuse a mesh with invalid values, which its reader accepted from a damaged file."""
    if not np.isfinite(part.vertices).all():
        raise MeshFileError("it has coordinates that are not finite")
    if part.vertices.ndim != 2 or part.vertices.shape[1] != len("xyz"):
        raise MeshFileError("it has points that do not have three coordinates")
    if len(part.vertices) and np.abs(part.vertices).max() > _FARTHEST:
        raise MeshFileError(f"it has coordinates beyond {_FARTHEST:g}")
    if len(part.faces) and not 0 <= part.faces.min() <= part.faces.max() < len(part.vertices):
        raise MeshFileError(
            f"a face refers to a vertex that is not one of its {len(part.vertices)}"
        )


def _check_companions(path: Path) -> None:
    """Refuse an .obj mesh file whose materials or textures are missing."""
    if path.suffix.lower() != ".obj":
        return
    for library in _named_files(path, "mtllib"):
        for image in _named_files(library, "map_Kd"):
            if not is_file(image):
                raise MeshFileError(f"'{library.name}' names the image '{image.name}': no file")


def _named_files(path: Path, keyword: str) -> list[Path]:
    """Return the files that lines of a text file name; options before the name are skipped."""
    if not is_file(path):
        raise MeshFileError(f"it refers to the materials file '{path.name}': no such file")
    if path.stat().st_size > MAX_MESH_BYTES:
        raise MeshFileError(f"'{path.name}' is larger than {MAX_MESH_BYTES} bytes")
    lines = path.read_text("utf-8", "replace").splitlines()
    pattern = re.compile(rf"\s*{keyword}\s+(?:-\S+\s+(?:[\d.+-]+\s+|on\s+|off\s+)*)*(.+)")
    found = [pattern.match(line) for line in lines]
    return [path.parent / each[1].strip() for each in found if each]


def _convert(part: Any, turn: FloatArray, *, is_linear: bool) -> Mesh:
    """Return a mesh of trimesh in FRD metres. is_linear: whether its colours are linear."""
    vertices = np.asarray(part.vertices, np.float64) @ turn.T
    uv = getattr(part.visual, "uv", None)
    uv = np.zeros((len(vertices), 2)) if uv is None or len(uv) != len(vertices) else np.array(uv)
    # Files count v upwards from the image's last row; this program downwards from its first.
    uv = np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1)
    old, normals, faces = smoothed(vertices, uv, np.ascontiguousarray(part.faces, np.int32))
    face_material, materials = _materials(part, is_linear=is_linear)
    return Mesh(vertices[old], normals, uv[old], faces, face_material, materials)


def _materials(part: Any, *, is_linear: bool) -> tuple[IntArray, tuple[Material, ...]]:
    """Return the material of each face in a mesh file, and the materials."""
    visual = part.visual
    if visual.kind in ("face", "vertex"):
        rgb = np.asarray(visual.face_colors, np.int32)[:, :3]
        if is_linear:
            rgb = SRGB_OF_LINEAR[rgb]
        if len(np.unique(rgb, axis=0)) > _MOST_COLORS:
            rgb = rgb // 32 * 32 + 16
        colors, index = np.unique(rgb, axis=0, return_inverse=True)
        return index.reshape(-1).astype(np.int32), tuple(Material(_rgb(each)) for each in colors)
    return np.zeros(len(part.faces), np.int32), (_material(visual, is_linear=is_linear),)


def _material(visual: Any, *, is_linear: bool) -> Material:
    """Return the material of a mesh file's visual: its texture or its colour.

    is_linear: whether the colour is, as in glTF (2.0, 3.9.2), where one that is left out is white.
    """
    material = getattr(visual, "material", None)
    factor = getattr(material, "baseColorFactor", None)
    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if image is not None:
        _check_texture(image)
        rgb = np.asarray(image.convert("RGB"), np.uint8)
        texture = to_powers_of_two(np.ascontiguousarray(rgb[:, :, ::-1]))
        return Material(_WHITE if factor is None else _color(factor, is_linear), texture)
    if is_linear and material is not None and factor is None:
        return Material(_WHITE)
    color = getattr(material, "main_color", None)
    return Material(_PLAIN_RGB if color is None else _color(color, is_linear))


def _color(color: Any, is_linear: bool) -> Rgb:
    """Return a material's colour, 0 to 255 of its file, as sRGB."""
    return _rgb(SRGB_OF_LINEAR[np.asarray(color, np.int32)] if is_linear else color)


def _check_texture(image: Any) -> None:
    try:
        check_pixels(*image.size)
    except ImageError as error:
        raise MeshFileError(f"an image in it cannot be decoded: {error}") from error


def _rgb(color: Any) -> Rgb:
    """Return the colour of a mesh file's material as integers."""
    return (int(color[0]), int(color[1]), int(color[2]))
