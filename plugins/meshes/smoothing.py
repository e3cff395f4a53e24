"""Computes normals for meshes without them: smooth where faces meet gently, sharp at edges."""

import math

import numpy as np
from numpy.typing import NDArray

from wil_campaign.worlds.scene.meshes import FloatArray, IntArray

CREASE_RAD = math.radians(40.0)
"""Faces that meet at more than this have an edge between them."""
_MOST_MEETING = 64
"""Where more corners than this meet (the tip of a fan), each face keeps its own normal."""
_STEPS = 4096.0

_Indices = NDArray[np.intp]


def smoothed_mesh(
    vertices_m: FloatArray, uv: FloatArray, faces: IntArray
) -> tuple[_Indices, FloatArray, IntArray]:
    """Return vertices with smooth normals: old vertex, normal, and the new faces.

    A vertex becomes several where an edge passes through it; those that are equal become one.
    Vertices at one place count as one, whether or not the file says so. Normals are weighted
    by the faces' angles (Thuermer and Wuethrich 1998); those of faces without area are 0.
    """
    corners = vertices_m[faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    place = _number_corners(vertices_m)[faces.ravel()]
    normals = _unit(_corner_normals(place, _unit(flat), _angles_rad(corners)))
    corner_uv = uv[faces.ravel()]
    keys = np.concatenate([place[:, None], corner_uv, np.round(normals * _STEPS)], axis=1)
    index = _number_corners(keys)
    first = np.empty(index.max(initial=-1) + 1, np.intp)
    first[index[::-1]] = np.arange(len(index))[::-1]
    return (
        faces.ravel()[first].astype(np.intp),
        normals[first],
        index.reshape(-1, 3).astype(np.int32),
    )


def _number_corners(rows: NDArray[np.float64]) -> _Indices:
    """Return a number per row of corners for smoothing; equal rows share it."""
    order = np.lexsort(rows.T)
    ordered = rows[order]
    is_new = (ordered[1:] != ordered[:-1]).any(axis=1)
    number = np.empty(len(rows), np.intp)
    number[order] = np.concatenate([[0], np.cumsum(is_new)])
    return number


def _angles_rad(corners: FloatArray) -> FloatArray:
    """Return the angle of a triangle at each corner, (3 m,), to weigh smooth normals."""
    on = _unit((np.roll(corners, -1, axis=1) - corners).reshape(-1, 3))
    back = _unit((np.roll(corners, 1, axis=1) - corners).reshape(-1, 3))
    return np.asarray(np.arccos(np.clip(np.einsum("ij,ij->i", on, back), -1.0, 1.0)))


def _corner_normals(place: _Indices, flat: FloatArray, angle_rad: FloatArray) -> FloatArray:
    """Return each corner's smooth normal: the sum over faces that meet it gently.

    place, angle_rad: (3 m,) of each corner. flat: (m, 3), unit normals of faces.
    """
    order = np.argsort(place, kind="stable")
    counts = np.bincount(place)
    few = np.where(counts <= _MOST_MEETING, counts, 0)
    begins = np.cumsum(counts) - counts
    partners = few[place[order]]
    one = np.repeat(order, partners)
    nth = np.arange(len(one)) - np.repeat(np.cumsum(partners) - partners, partners)
    other = order[np.repeat(begins[place[order]], partners) + nth]
    gentle = np.einsum("ij,ij->i", flat[one // 3], flat[other // 3]) >= math.cos(CREASE_RAD)
    gentle &= one != other
    one, other = one[gentle], other[gentle]
    weighted = np.repeat(flat, 3, axis=0) * angle_rad[:, None]
    return weighted + np.stack(
        [np.bincount(one, weighted[other, axis], len(place)) for axis in range(3)], axis=1
    )


def _unit(vectors: FloatArray) -> FloatArray:
    """Return smoothed normals scaled to length 1; zeros stay."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    unit = np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0.0)
    return np.asarray(unit)
