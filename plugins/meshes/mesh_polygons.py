"""Refuses polygons of mesh files that a fan of triangles would fill beyond their outline.

The readers of .obj, .ply and .dae files make each face of more than three corners a fan about its
first corner. It is the polygon itself where every triangle of the fan turns as the polygon does;
else it lies also where the file has nothing, as across the opening of a U.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from wil_campaign.plugins.meshes.mesh_support import UnsupportedMeshError
from wil_campaign.worlds.scene.meshes import FloatArray

_DEPTH_SHARE = 1e-3
"""Of the size of a polygon: a hollow that is not deeper is a rounding, and is filled."""
_ROUNDING = 5e-7
"""Of the largest coordinate: some units in the last place of single precision."""
_FACE_LISTS = ("vertex_index", "vertex_indices")

Integers = NDArray[np.int64]
Number = TypeVar("Number", np.int64, np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class MeshPolygons:
    """Polygons of a mesh: points (n, 3); corners, the indices of all, and sizes, of each."""

    points: FloatArray
    corners: Integers
    sizes: Integers

    def large(self) -> "MeshPolygons":
        """Return the polygons of more than three corners."""
        is_large = self.sizes > len("xyz")
        return MeshPolygons(
            self.points, self.corners[np.repeat(is_large, self.sizes)], self.sizes[is_large]
        )


def numbers_in_text(text: str | bytes, kind: type[Number]) -> NDArray[Number]:
    """Return the numbers of a text, between white space. Raises ValueError for anything else."""
    # A list of texts would take ten times the memory.
    return np.fromstring(text, kind, sep=" ") if text.strip() else np.empty(0, kind)


def check_polygons(polygons: MeshPolygons) -> None:
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


def polygon_fans(sizes: Integers) -> Integers:
    """Return the triangles (m, 3) of polygons, fans about their first corners, of all corners.

    sizes: of each polygon, at least 3 corners.
    """
    count = sizes - 2
    first_corner = np.cumsum(sizes) - sizes
    apex = np.repeat(first_corner, count)
    step = np.arange(len(apex)) - np.repeat(np.cumsum(count) - count, count) + 1
    return np.stack([apex, apex + step, apex + step + 1], axis=1)


def _is_overlapped(polygons: MeshPolygons) -> NDArray[np.bool_]:
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


def ply_polygons(raw: Mapping[str, Any]) -> MeshPolygons | None:
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


def _listed(points: FloatArray, lists: NDArray[Any]) -> MeshPolygons:
    """Return polygons by the corners of each: an array (n, k), or n arrays of any lengths."""
    if lists.ndim > 1:
        sizes = np.full(len(lists), lists.shape[1], np.int64)
        return MeshPolygons(points, lists.reshape(-1).astype(np.int64), sizes)
    sizes = np.array([len(each) for each in lists], np.int64)
    return MeshPolygons(points, np.concatenate([*lists]).astype(np.int64), sizes)
