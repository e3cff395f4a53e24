"""Openings of meshes to be flown through: a polygon, or the outline of the mesh round a point."""

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.ops import polygonize, unary_union

from wil_campaign.worlds.frames import Pose, Vec3, quat_from_matrix
from wil_campaign.worlds.scene.meshes import FloatArray, Mesh, vec3
from wil_campaign.worlds.scene.parts import ObjectOpening

_FORWARD, _DOWN = np.array((1.0, 0.0, 0.0)), np.array((0.0, 0.0, 1.0))
_FLAT_SHARE, _FLAT_M = 0.02, 0.005
"""How far corners may be from their plane: a share of the size, and a length."""
_LEAST_ALONG = 0.2
"""The least cosine of the angle between the plane's axis and the way through."""
_WELD_M = 1e-6
_SMOOTH_M = 1e-4
_MOST_CORNERS = 400
_POLE_SHARE = 0.01


class OpeningError(ValueError):
    """An opening cannot be read: why, and what to give instead."""


def polygon_opening(
    corners_m: FloatArray, through: Vec3, mesh: Mesh | None = None
) -> ObjectOpening:
    """Return the opening of a plane polygon, flown through along `through`.

    corners_m: (n, 3) in the object's FRD frame, in their order round the opening. Its centre is
    where the nearest edge is farthest. mesh: which must leave it open. Raises OpeningError.
    """
    middle = corners_m.mean(axis=0)
    _, sizes, axes = np.linalg.svd(corners_m - middle)
    size_m = float(np.ptp(corners_m, axis=0).max())
    if sizes[1] <= _WELD_M:
        raise OpeningError("the corners are on a line; give three that are not")
    off_m = float(np.abs((corners_m - middle) @ axes[2]).max())
    if off_m > _FLAT_M + _FLAT_SHARE * size_m:
        raise OpeningError(f"the corners are up to {off_m:.3g} m off a plane; give plane ones")
    opening = _plane_opening(corners_m, middle, axes[2], through)
    if mesh is not None and _is_material(mesh, np.array(opening.pose.position_ned_m), through):
        raise OpeningError("its centre is in the material of the mesh; give the corners of a hole")
    return opening


def outline_opening(mesh: Mesh, at_m: Vec3, through: Vec3) -> ObjectOpening:
    """Return the opening whose outline the mesh has round a point of its plane.

    The mesh is cut by the plane through at_m, across `through`; the outline is the smallest closed
    line of the cut round the point. Raises OpeningError where there is none.
    """
    axis, at = np.array(through), np.array(at_m)
    right, down = _across(axis)
    segments = _cut(mesh, at, axis) @ np.stack([right, down], axis=1)
    if _is_material(mesh, at, through):
        raise OpeningError("this point is in the material of the mesh; give one in the opening")
    lines = [shapely.LineString(segment) for segment in segments]
    rings = polygonize(unary_union(lines)) if lines else ()
    point = shapely.Point(0.0, 0.0)
    found = [ring for ring in rings if ring.contains(point)]
    if not found:
        raise OpeningError(
            "the mesh has no closed outline round this point, in the plane across the way through; "
            "give a point within the opening's depth, or polygon_m"
        )
    outline = min(found, key=lambda ring: float(ring.area)).simplify(_SMOOTH_M)
    flat = np.array(outline.exterior.coords)[:-1]
    return _plane_opening(at + flat[:, :1] * right + flat[:, 1:] * down, at, axis, through)


def _is_material(mesh: Mesh, at: FloatArray, through: Vec3) -> bool:
    """Return whether a point is in the material that a closed mesh bounds."""
    axis = np.array(through)
    segments = _cut(mesh, at, axis) @ np.stack(_across(axis), axis=1)
    return _is_closed(mesh) and _crossings_beside(segments) % 2 == 1


def _is_closed(mesh: Mesh) -> bool:
    """Return whether a mesh bounds material: no edge is open, though bodies may share one."""
    corners = np.round(mesh.vertices_m / _WELD_M) * _WELD_M
    index = np.unique(corners, axis=0, return_inverse=True)[1].reshape(-1)
    edges = np.sort(index[mesh.faces][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return bool((np.unique(edges, axis=0, return_counts=True)[1] % 2 == 0).all())


def _crossings_beside(segments: FloatArray) -> int:
    """Return how many segments (n, 2, 2) a ray from the origin crosses: odd within material."""
    (u, v), (end_u, end_v) = segments[:, 0].T, segments[:, 1].T
    spans = (v > 0.0) != (end_v > 0.0)
    share = v[spans] / (v - end_v)[spans]
    return int((u[spans] + share * (end_u - u)[spans] > 0.0).sum())


def _plane_opening(
    corners_m: FloatArray, at: FloatArray, normal: FloatArray, through: Vec3
) -> ObjectOpening:
    along = float(normal @ np.array(through))
    if abs(along) < _LEAST_ALONG:
        raise OpeningError("its plane lies along the way through; name another way by through")
    axis = normal if along > 0.0 else -normal
    right, down = _across(axis)
    flat = (corners_m - at) @ np.stack([right, down], axis=1)
    outline = shapely.Polygon(flat)
    if not outline.is_valid:
        raise OpeningError("its outline crosses itself; give the corners in their order round it")
    if len(flat) > _MOST_CORNERS:
        raise OpeningError(f"its outline has {len(flat)} corners; at most {_MOST_CORNERS} are read")
    size_m = float(np.ptp(flat, axis=0).max())
    pole = shapely.ops.polylabel(outline, tolerance=_POLE_SHARE * size_m)
    limit_m = float(outline.exterior.distance(pole))
    centre = np.array((pole.x, pole.y))
    rotation = np.stack([axis, right, down], axis=1)
    pose = Pose(vec3(at + centre[0] * right + centre[1] * down), quat_from_matrix(rotation))
    corners = tuple((float(u), float(v)) for u, v in flat - centre)
    return ObjectOpening("opening", "polygon", limit_m, pose, corners)


def _across(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return right and down of a plane that is flown through along an axis."""
    upright = _FORWARD if abs(axis @ _DOWN) > 0.9 else _DOWN
    down = upright - (upright @ axis) * axis
    down /= np.linalg.norm(down)
    return np.cross(down, axis), down


def _cut(mesh: Mesh, at: FloatArray, axis: FloatArray) -> NDArray[np.float64]:
    """Return the segments (n, 2, 3) in which a plane cuts a mesh, from a point of the plane."""
    corners, index = np.unique(
        np.round(mesh.vertices_m / _WELD_M) * _WELD_M, axis=0, return_inverse=True
    )
    faces = index.reshape(-1)[mesh.faces]
    off_m = (corners - at) @ axis
    off_m[np.abs(off_m) < _WELD_M] = _WELD_M  # a corner in the plane is before it
    ahead = off_m > 0.0
    crossing = faces[ahead[faces].any(axis=1) & ~ahead[faces].all(axis=1)]
    ends = []
    for one, other in ((0, 1), (1, 2), (2, 0)):
        # Each edge in one order: two faces have the same point of it, to the bit.
        pair = np.sort(crossing[:, [one, other]], axis=1)
        before, after = off_m[pair[:, 0]], off_m[pair[:, 1]]
        is_cut = (before > 0.0) != (after > 0.0)
        share = np.where(is_cut, before / np.where(is_cut, before - after, 1.0), np.nan)
        points = corners[pair[:, 0]] + share[:, None] * (corners[pair[:, 1]] - corners[pair[:, 0]])
        ends.append(points - at)
    found = np.stack(ends, axis=1)
    is_end = ~np.isnan(found[:, :, 0])
    return found[is_end].reshape(-1, 2, 3)
