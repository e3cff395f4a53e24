"""Refuses polygons of mesh files that a fan of triangles would fill beyond their outline.

The readers of .obj, .ply and .dae files make each face of more than three corners a fan about its
first corner. It is the polygon itself where every triangle of the fan turns as the polygon does;
else it lies also where the file has nothing, as across the opening of a U.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from worlds.scene.mesh_files.mesh_support import UnsupportedMeshError
from worlds.scene.meshes import FloatArray

_DEPTH_SHARE = 1e-3
"""Of the size of a polygon: a hollow that is not deeper is a rounding, and is filled."""
_ROUNDING = 5e-7
"""Of the largest coordinate: some units in the last place of single precision."""
_FACE_LISTS = ("vertex_index", "vertex_indices")

Integers = NDArray[np.int64]
Number = TypeVar("Number", np.int64, np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Polygons:
    """Polygons of a mesh: points (n, 3); corners, the indices of all, and sizes, of each."""

    points: FloatArray
    corners: Integers
    sizes: Integers

    def large(self) -> "Polygons":
        """Return the polygons of more than three corners."""
        is_large = self.sizes > len("xyz")
        return Polygons(
            self.points, self.corners[np.repeat(is_large, self.sizes)], self.sizes[is_large]
        )


def numbers(text: str | bytes, kind: type[Number]) -> NDArray[Number]:
    """Return the numbers of a text, between white space. Raises ValueError for anything else."""
    # A list of texts would take ten times the memory.
    return np.fromstring(text, kind, sep=" ") if text.strip() else np.empty(0, kind)


def check_polygons(polygons: Polygons) -> None:
    """Raise UnsupportedMeshError for a polygon that its fan of triangles would overlap.

    Raises IndexError for a corner that is none of the points, ValueError for sizes that do not fit.
    """
    if int(polygons.sizes.sum()) != len(polygons.corners):
        raise ValueError("the polygons have other corners than they state")
    large = polygons.large()
    if not len(large.sizes):
        return
    with np.errstate(invalid="ignore", over="ignore"):
        found = np.flatnonzero(_is_overlapped(large))
    if len(found):
        raise UnsupportedMeshError(
            f"a face with {large.sizes[found[0]]} corners is concave, and would be filled beyond "
            "its outline; export the mesh with triangulated faces"
        )


def _is_overlapped(polygons: Polygons) -> NDArray[np.bool_]:
    """Return which polygons have a triangle in their fan that turns the other way.

    A polygon turns about the sum of its triangles' normals (Newell's), flat or not.
    """
    count = polygons.sizes - 2
    first_triangle, first_corner = np.cumsum(count) - count, np.cumsum(polygons.sizes)
    first_corner -= polygons.sizes
    owner = np.repeat(np.arange(len(count)), count)
    apex = first_corner[owner]
    step = np.arange(len(owner)) - first_triangle[owner] + 1
    at = polygons.points[polygons.corners]
    b, c = at[apex + step] - at[apex], at[apex + step + 1] - at[apex]
    twice_area = np.cross(b, c)
    normal = np.add.reduceat(twice_area, first_triangle)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0.0)
    reversed_area = -np.einsum("ij,ij->i", twice_area, normal[owner])
    longest = np.sqrt(np.max([(side * side).sum(axis=1) for side in (b, c, c - b)], axis=0))
    size = np.maximum.reduceat(longest, first_triangle)
    hollow = _DEPTH_SHARE * size + _ROUNDING * np.abs(at).max()
    overlapped: NDArray[np.bool_] = np.logical_or.reduceat(
        reversed_area > hollow[owner] * longest, first_triangle
    )
    return overlapped


def ply_polygons(raw: Mapping[str, Any]) -> Polygons | None:
    """Return the polygons in trimesh's raw elements of a PLY file; None for no faces.

    Raises UnsupportedMeshError for a binary file whose faces it took apart at wrong places.
    """
    face = raw.get("face", {}).get("data")
    if face is None:
        return None
    vertex = raw["vertex"]["data"]
    points = np.column_stack([np.ravel(vertex[axis]) for axis in "xyz"]).astype(np.float64)
    if isinstance(face, Mapping):
        name = next((name for name in _FACE_LISTS if name in face), None)
        return None if name is None else _listed(points, face[name])
    names = face.dtype.names
    lists = face[next((name for name in names if name in _FACE_LISTS), names[0])]
    if (lists["f0"] != lists["f1"].shape[1]).any():
        raise UnsupportedMeshError(
            "its faces have different numbers of corners, which is not supported in a binary .ply "
            "file; export the mesh with triangulated faces"
        )
    return _listed(points, lists["f1"])


def _listed(points: FloatArray, lists: NDArray[Any]) -> Polygons:
    """Return polygons by the corners of each: an array (n, k), or n arrays of any lengths."""
    if lists.ndim > 1:
        sizes = np.full(len(lists), lists.shape[1], np.int64)
        return Polygons(points, lists.reshape(-1).astype(np.int64), sizes)
    sizes = np.array([len(each) for each in lists], np.int64)
    return Polygons(points, np.concatenate([*lists]).astype(np.int64), sizes)


def check_collada_polygons(root: ET.Element) -> None:
    """Raise UnsupportedMeshError for Collada polygons that are concave or cannot be read.

    Collada 1.4.1, chapter 5: "polylist", "polygons".
    """
    for mesh in root.iterfind(".//{*}geometry/{*}mesh"):
        try:
            for polygons in _collada_polygons(mesh):
                check_polygons(polygons)
        except (ValueError, IndexError, KeyError, TypeError, AttributeError) as error:
            raise UnsupportedMeshError(
                "its polygons cannot be read; export the mesh with triangulated faces"
            ) from error


def _collada_polygons(mesh: ET.Element) -> Iterator[Polygons]:
    for part in (*mesh.iterfind("{*}polylist"), *mesh.iterfind("{*}polygons")):
        if part.find("{*}ph") is not None:
            raise UnsupportedMeshError(
                "it has polygons with holes, which are not supported; export the mesh with "
                "triangulated faces"
            )
        inputs = [*part.iterfind("{*}input")]
        stride = 1 + max(int(one.get("offset", "0")) for one in inputs)
        offset = next((one.get("offset") for one in inputs if one.get("semantic") == "VERTEX"), "")
        lists = [_integers(one) for one in part.iterfind("{*}p")]
        if not lists:
            continue
        counts = part.find("{*}vcount")
        sizes = (
            np.array([len(one) // stride for one in lists], np.int64)
            if counts is None
            else _integers(counts)
        )
        rows = np.concatenate(lists).reshape(-1, stride)
        yield Polygons(_collada_points(mesh), rows[:, int(offset or "0")], sizes)


def _collada_points(mesh: ET.Element) -> FloatArray:
    """Return the positions (n, 3) of a Collada mesh's vertices."""
    inputs = mesh.iterfind("{*}vertices/{*}input")
    names = {one.get("semantic"): one.get("source", "") for one in inputs}
    sources = {one.get("id"): one for one in mesh.iterfind("{*}source")}
    source = sources[names["POSITION"].removeprefix("#")]
    values = numbers(source.findtext("{*}float_array") or "", np.float64)
    accessor = source.find("{*}technique_common/{*}accessor")
    stride = 3 if accessor is None else int(accessor.get("stride", "3"))
    return values.reshape(-1, stride)[:, :3]


def _integers(element: ET.Element) -> Integers:
    return numbers(element.text or "", np.int64)
