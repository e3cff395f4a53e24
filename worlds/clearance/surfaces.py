"""Distance from a convex body to any triangles, through a tree of boxes about them.

The tree is a pyramid over triangles sorted along a Morton curve (Lauterbach and others 2009):
node k has children 2 k and 2 k + 1, the leaves hold LEAF triangles each. Distances to triangles
are those of worlds/clearance/gjk.py, with their proof; boxes only leave out what is farther.
"""

from typing import NamedTuple

import numpy as np

from wil_campaign.worlds.clearance.gjk import PRECISION_M, Vector, convex_distance, hull_at_pose
from wil_campaign.worlds.jit import F64, Float, jit_compiled
from wil_campaign.worlds.scene.meshes import FloatArray, IntArray

LEAF = 4
_CELLS = 1023
_DEEPEST = 64
_Quat = tuple[Float, Float, Float, Float]


class TriangleTree(NamedTuple):
    """A tree of surface triangles (n, 3, 3) with the boxes (nodes, 2, 3) of its nodes.

    The root is node 1. Where a leaf has too few triangles, its last are repeated.
    """

    triangles: F64
    boxes: F64


def triangle_tree(vertices_m: FloatArray, faces: IntArray) -> TriangleTree:
    """Return the bounding-box tree of a mesh's surface triangles."""
    triangles = vertices_m[faces]
    triangles = triangles[np.argsort(_morton_codes(triangles.mean(axis=1)), kind="stable")]
    leaves = 1 << max(0, (-(-len(triangles) // LEAF) - 1).bit_length())
    # Spread evenly, so that no leaf is empty and none is long.
    places = np.arange(leaves * LEAF) * len(triangles) // (leaves * LEAF)
    triangles = np.ascontiguousarray(triangles[places], np.float64)
    boxes = np.zeros((2 * leaves, 2, 3))
    corners = triangles.reshape(leaves, 3 * LEAF, 3)
    boxes[leaves:, 0], boxes[leaves:, 1] = corners.min(axis=1), corners.max(axis=1)
    first = leaves // 2
    while first:
        pairs = boxes[2 * first : 4 * first].reshape(first, 2, 2, 3)
        boxes[first : 2 * first, 0] = pairs[:, :, 0].min(axis=1)
        boxes[first : 2 * first, 1] = pairs[:, :, 1].max(axis=1)
        first //= 2
    return TriangleTree(triangles, boxes)


def _morton_codes(points: FloatArray) -> np.ndarray:
    """Return the Morton codes of points: near triangles get near places in the tree."""
    low, size = points.min(axis=0), np.ptp(points, axis=0).max() or 1.0
    cells = ((points - low) / size * _CELLS).astype(np.int64)
    codes = np.zeros(len(points), np.int64)
    for bit in range(10):
        for axis in range(3):
            codes |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return codes


@jit_compiled
def gap_of_boxes(low: F64, high: F64, box: F64) -> Float:
    """Return the distance between two axis-aligned boxes of a triangle tree."""
    total = 0.0
    for axis in range(3):
        apart = max(low[axis] - box[1, axis], box[0, axis] - high[axis], 0.0)
        total += apart * apart
    return np.sqrt(total)


@jit_compiled
def corner_extent(corners: F64) -> tuple[F64, F64]:
    """Return the least and greatest coordinates of corners, for a triangle tree."""
    low, high = corners[0].copy(), corners[0].copy()
    for i in range(1, corners.shape[0]):
        for axis in range(3):
            low[axis] = min(low[axis], corners[i, axis])
            high[axis] = max(high[axis], corners[i, axis])
    return low, high


@jit_compiled
def nearest_triangle(corners: F64, tree: TriangleTree, enough_m: Float, limit_m: Float) -> Float:
    """Return a lower bound, to PRECISION_M, of a hull's distance from a surface's triangles.

    Triangles farther than limit_m count as that far. Ends as soon as a triangle is nearer than
    enough_m, and returns its distance then.
    """
    low, high = corner_extent(corners)
    waiting, distance = np.empty(_DEEPEST, np.int64), np.empty(_DEEPEST)
    leaves, best = tree.boxes.shape[0] // 2, limit_m
    waiting[0], distance[0], count = 1, gap_of_boxes(low, high, tree.boxes[1]), 1
    while count and best >= enough_m:
        count -= 1
        node = waiting[count]
        if distance[count] >= best:
            continue
        if node >= leaves:
            first = (node - leaves) * LEAF
            for t in range(first, first + LEAF):
                _, _, at_least = convex_distance(corners, tree.triangles[t])
                best = min(best, at_least)
            continue
        left, right = 2 * node, 2 * node + 1
        gap_left = gap_of_boxes(low, high, tree.boxes[left])
        gap_right = gap_of_boxes(low, high, tree.boxes[right])
        if gap_left < gap_right:
            left, right, gap_left, gap_right = right, left, gap_right, gap_left
        waiting[count], distance[count] = left, gap_left
        waiting[count + 1], distance[count + 1] = right, gap_right
        count += 2
    return best


@jit_compiled
def surface_distance(body: F64, position: Vector, q_wxyz: _Quat, tree: TriangleTree) -> Float:
    """Return the distance of a body at a pose to a triangle surface, 0 when it touches."""
    return nearest_triangle(hull_at_pose(body, position, q_wxyz), tree, PRECISION_M, np.inf)


@jit_compiled
def is_swept_beyond(
    body: F64, first: tuple[Vector, _Quat], last: tuple[Vector, _Quat], tree: TriangleTree, m: Float
) -> bool:
    """Return whether a body's hull over two poses is at least m metres from a surface."""
    before, after = hull_at_pose(body, first[0], first[1]), hull_at_pose(body, last[0], last[1])
    return bool(nearest_triangle(np.concatenate((before, after)), tree, m, np.inf) >= m)
