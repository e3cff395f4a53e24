"""Meshes from files: .obj, .stl, .glb, .gltf, .dae, .ply.

Diagnoses a mesh file that cannot be read, by the rules of its format.
"""

import json
import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from wil_campaign.foundation.files.lfs import LFS_POINTER, is_lfs_pointer
from wil_campaign.foundation.files.limits import MAX_MESH_FACES
from wil_campaign.foundation.files.paths import is_file
from wil_campaign.plugins.meshes.formats.collada_file import read_collada
from wil_campaign.plugins.meshes.formats.gltf_file import open_gltf, read_gltf
from wil_campaign.plugins.meshes.formats.obj_file import read_obj
from wil_campaign.plugins.meshes.formats.ply_file import read_ply
from wil_campaign.plugins.meshes.formats.stl_file import read_stl
from wil_campaign.plugins.meshes.looks import FilePart, LookPainter
from wil_campaign.plugins.meshes.mesh_limits import (
    MeshLimitError,
    check_gltf,
    check_mesh_file_size,
    check_ply,
    open_collada,
)
from wil_campaign.plugins.meshes.mesh_support import UnsupportedMeshError
from wil_campaign.plugins.meshes.smoothing import smoothed_mesh
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.mesh_formats import MeshAxes, MeshFileError, Unit
from wil_campaign.worlds.scene.meshes import FloatArray, Mesh, merge_meshes
from wil_campaign.worlds.scene.parts import SolidPart, SurfaceShape
from wil_campaign.worlds.scene.shapes import Shape

_GLB_HEAD = struct.Struct("<4sII")
_GLB_CHUNK = struct.Struct("<I4s")
_STL_HEAD_BYTES, _STL_FACET_BYTES = 84, 50


def mesh_file_damage(path: Path) -> str:
    """Return how a mesh file of a known suffix is damaged or malformed; "" when sound.

    GLB: glTF 2.0, chapter 4.4 "Binary glTF Layout". STL: 80 bytes, a count, 50 bytes a facet.
    """
    data = path.read_bytes()
    if not data:
        return "it is empty"
    if is_lfs_pointer(data):
        return LFS_POINTER
    diagnose = _DIAGNOSES.get(path.suffix.lower())
    return "" if diagnose is None else diagnose(data)


def _glb(data: bytes) -> str:
    """Return how a GLB mesh file is damaged; "" when sound."""
    if data[:4] != b"glTF":
        return "it is not a GLB file: it does not begin with 'glTF'"
    if len(data) < _GLB_HEAD.size + _GLB_CHUNK.size:
        return f"it is cut off after {len(data)} bytes"
    _, version, length = _GLB_HEAD.unpack_from(data)
    if version != 2:
        return f"it is of glTF version {version}; only version 2 is supported"
    if len(data) < length:
        return f"it is cut off: {len(data)} of {length} bytes are there"
    count, kind = _GLB_CHUNK.unpack_from(data, _GLB_HEAD.size)
    if kind != b"JSON":
        return "its first chunk is not JSON"
    begin = _GLB_HEAD.size + _GLB_CHUNK.size
    return _json(data[begin : begin + count], "its description")


def _json(data: bytes, what: str) -> str:
    """Return how a glTF mesh file's JSON is damaged; "" when sound."""
    try:
        document = json.loads(data)
    except json.JSONDecodeError as error:
        return f"{what} is not JSON (line {error.lineno}, column {error.colno})"
    except (UnicodeDecodeError, RecursionError):
        return f"{what} is not JSON"
    if not isinstance(document, dict) or not isinstance(document.get("asset"), dict):
        return f"{what} is JSON but not glTF"
    version = str(document["asset"].get("version", "unknown"))
    if not version.startswith("2."):
        return f"it is of glTF version {version[:20]}; only version 2 is supported"
    return ""


def _xml(data: bytes) -> str:
    """Return how a Collada mesh file's XML is damaged; "" when sound."""
    try:
        root = ET.fromstring(data)  # noqa: S314 - a file that the user names, on the user's machine
    except ET.ParseError as error:
        line, column = error.position
        return f"it is not XML (line {line}, column {column + 1})"
    return "" if root.tag.endswith("COLLADA") else "it is XML but not Collada"


def _stl(data: bytes) -> str:
    """Return how a binary STL mesh file is damaged; "" when sound."""
    if data[:5].lower() == b"solid":
        return "its text is not STL: facets need three vertices"
    if len(data) < _STL_HEAD_BYTES:
        return f"it is cut off after {len(data)} bytes"
    (count,) = struct.unpack_from("<I", data, _STL_HEAD_BYTES - 4)
    there = (len(data) - _STL_HEAD_BYTES) // _STL_FACET_BYTES
    if there < count:
        return f"it is cut off: {there} of {count} facets are there"
    return ""


_DIAGNOSES: Mapping[str, Callable[[bytes], str]] = {
    ".glb": _glb,
    ".gltf": partial(_json, what="it"),
    ".dae": _xml,
    ".stl": _stl,
}


METRES: dict[Unit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
SUFFIXES = (".obj", ".stl", ".glb", ".gltf", ".dae", ".ply")
MAX_FACES = MAX_MESH_FACES
_FARTHEST = 1e9
"""Of a coordinate in the file's own unit: a thousand kilometres of millimetres."""
_NO_AREA = 1e-12
"""Of the square of the longest edge: what is left of no area after rounding."""


Y_UP = MeshAxes("y", "z")
"""glTF 2.0, section 3.4: +Y up, +Z forward; Collada's default is Y up as well."""
Z_UP = MeshAxes("z", "x")
"""REP 103: x forward, z up."""


def default_mesh_axes(path: Path, asset: "MeshAsset") -> MeshAxes:
    """Return the axes that a mesh file states, else the custom of its format."""
    if asset.up_axis is not None:
        return asset.up_axis
    return Y_UP if path.suffix.lower() in (".glb", ".gltf", ".dae") else Z_UP


@dataclass(frozen=True, slots=True)
class MeshAsset:
    """A mesh file's own statements: metres per unit, and its axes. Only Collada has them."""

    unit_m: float = 1.0
    up_axis: MeshAxes | None = None


_COLLADA_AXES = {"X_UP": MeshAxes("x", "z"), "Y_UP": Y_UP, "Z_UP": Z_UP}


def _asset(root: ET.Element) -> MeshAsset:
    """Return the unit and axes that a Collada mesh file states (1.4.1, chapter 5, "asset").

    Raises MeshFileError for a unit that is no length.
    """
    unit, axes = root.find("{*}asset/{*}unit"), root.findtext("{*}asset/{*}up_axis")
    written = None if unit is None else unit.get("meter")
    unit_m = 1.0 if written is None else _metres(written)
    return MeshAsset(unit_m, _COLLADA_AXES.get((axes or "").strip()))


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
    path: Path,
    *,
    unit: Unit | None = None,
    scale: float = 1.0,
    axes: MeshAxes | None = None,
    draws_transparent: bool = False,
) -> Shape:
    """Return the shape in a mesh file; its surface is what can be touched.

    unit, axes: None for what the file states, else for metres and for its format's custom.
    draws_transparent: transparent surfaces are drawn as opaque, else refused. Raises MeshFileError
    with the reason when the file is missing, of no known kind, not a mesh, empty, not finite, or
    has more than MAX_FACES faces, when a file that it names is missing, and when it has what would
    be left out or misread, or look otherwise.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise MeshFileError(f"'{path.suffix}' is not one of {', '.join(SUFFIXES)}")
    if not is_file(path):
        raise MeshFileError("no such file")
    try:
        asset, parts = _read(path)
        turn = (axes or default_mesh_axes(path, asset)).frd_from_file()
        turn = turn * (scale * (METRES[unit] if unit else asset.unit_m))
        painter = LookPainter(draws_transparent=draws_transparent)
        meshes = [_convert(part, turn, painter) for part in parts]
    except (MeshLimitError, UnsupportedMeshError) as error:
        raise MeshFileError(str(error)) from error
    if not meshes:
        why = mesh_file_damage(path)
        raise MeshFileError(f"it has no triangles{': ' if why else ''}{why}")
    mesh = merge_meshes(meshes)
    _check_area(mesh)
    surface = SurfaceShape(mesh.vertices_m, mesh.faces)
    return Shape("mesh", mesh, (SolidPart("surface", surface, Pose((0.0, 0.0, 0.0))),))


def _read(path: Path) -> tuple[MeshAsset, list[FilePart]]:
    """Return what a mesh file states, and its parts with triangles, their places applied."""
    check_mesh_file_size(path)
    asset = MeshAsset()
    try:
        match path.suffix.lower():
            case ".obj":
                parts = read_obj(path)
            case ".stl":
                parts = read_stl(path)
            case ".ply":
                check_ply(path)
                parts = read_ply(path)
            case ".dae":
                root = open_collada(path)
                asset, parts = _asset(root), read_collada(path, root)
            case _:
                gltf = open_gltf(path)
                check_gltf(path, gltf.document)
                parts = read_gltf(gltf)
    except (MeshLimitError, UnsupportedMeshError, MeshFileError):
        raise
    except Exception as error:
        # A damaged file may have anything anywhere, and readers behind trimesh raise any exception.
        why = mesh_file_damage(path) or "it is damaged, or its format does not match its suffix"
        raise MeshFileError(f"cannot be read as a mesh: {why}") from error
    if sum(len(part.faces) for part in parts) > MAX_FACES:
        raise MeshFileError(f"it has more than {MAX_FACES} faces; reduce it to fewer")
    parts = [part for part in parts if len(part.faces)]
    for part in parts:
        _check_part(part)
        _check_looks(part)
    return asset, parts


def _check_area(mesh: Mesh) -> None:
    """Refuse a mesh that nothing can see or touch: compressed data that were read as zeros."""
    corners = mesh.vertices_m[mesh.faces]
    edges = corners[:, 1:] - corners[:, :1]
    twice_area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    if twice_area.max() <= _NO_AREA * np.abs(edges).max() ** 2:
        raise MeshFileError(f"none of its {len(mesh.faces)} triangles has an area")


def _check_part(part: FilePart) -> None:
    """Refuse a mesh with invalid values, which its reader accepted from a damaged file."""
    if not np.isfinite(part.vertices).all():
        raise MeshFileError("it has coordinates that are not finite")
    if part.vertices.ndim != 2 or part.vertices.shape[1] != len("xyz"):
        raise MeshFileError("it has points that do not have three coordinates")
    if len(part.vertices) and np.abs(part.vertices).max() > _FARTHEST:
        raise MeshFileError(f"it has coordinates beyond {_FARTHEST:g}")
    if not 0 <= part.faces.min() <= part.faces.max() < len(part.vertices):
        raise MeshFileError(
            f"a face refers to a vertex that is not one of its {len(part.vertices)}"
        )


def _check_looks(part: FilePart) -> None:
    """Refuse texture coordinates and colours of another number than the points or faces."""
    if part.uv is not None and part.uv.shape != (len(part.vertices), 2):
        raise MeshFileError("its texture coordinates do not fit its points")
    if part.colors is not None:
        count = len(part.faces if part.is_by_face else part.vertices)
        if part.colors.shape not in ((count, 3), (count, 4)) or not np.isfinite(part.colors).all():
            raise MeshFileError("its colours do not fit its points or faces, or are not finite")


def _convert(part: FilePart, turn: FloatArray, painter: LookPainter) -> Mesh:
    """Return a part of a mesh file in FRD metres, with what the renderer draws of its look."""
    vertices = part.vertices @ turn.T
    uv, face_material, materials = painter.paint(part)
    old, normals, faces = smoothed_mesh(vertices, uv, np.ascontiguousarray(part.faces, np.int32))
    return Mesh(vertices[old], normals, uv[old], faces, face_material, materials)
