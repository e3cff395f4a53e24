"""Distance between convex bodies given by their corners: exact, with a proof of each result.

The algorithm of Gilbert, Johnson and Keerthi (1988) with the closest points of Ericson (2004,
5.1). Any direction separates two convex bodies by a lower bound of their distance, any two of
their points are an upper one; here both are kept, and they must meet. (FCL's own, by libccd,
gives distances that are off by a quarter where boxes are parallel, which hovering vehicles are.)
"""

import numpy as np

from wil_campaign.worlds.jit import F64, Float, Int, jit_compiled

PRECISION_M = 1e-7
_MOST_STEPS = 100
Vector = tuple[Float, Float, Float]
"""Three coordinates, metres."""


@jit_compiled
def gjk_dot(a: Vector, b: Vector) -> Float:
    """Return the inner product of two vectors (GJK kernel)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jit_compiled
def gjk_minus(a: Vector, b: Vector) -> Vector:
    """Return a - b of two vectors (GJK kernel)."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@jit_compiled
def gjk_cross(a: Vector, b: Vector) -> Vector:
    """Return the cross product of two vectors (GJK kernel)."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@jit_compiled
def support_corner(corners: F64, direction: Vector) -> Int:
    """Return the support corner along a direction (GJK kernel); the first of equals."""
    best, best_value = 0, -np.inf
    for i in range(corners.shape[0]):
        value = (
            corners[i, 0] * direction[0]
            + corners[i, 1] * direction[1]
            + corners[i, 2] * direction[2]
        )
        if value > best_value:
            best, best_value = i, value
    return best


@jit_compiled
def simplex_corner(simplex: F64, i: Int) -> Vector:
    """Return one corner of the GJK simplex."""
    return simplex[i, 0], simplex[i, 1], simplex[i, 2]


@jit_compiled
def nearest_on_simplex_edge(simplex: F64, i: Int, j: Int) -> tuple[Vector, Int]:
    """Return the point of a simplex's edge nearest to the origin, and its corners as bits."""
    a, b = simplex_corner(simplex, i), simplex_corner(simplex, j)
    along = gjk_minus(b, a)
    length = gjk_dot(along, along)
    t = -gjk_dot(a, along) / length if length > 0.0 else 0.0
    if t <= 0.0:
        return a, 1 << i
    if t >= 1.0:
        return b, 1 << j
    return (a[0] + along[0] * t, a[1] + along[1] * t, a[2] + along[2] * t), (1 << i) | (1 << j)


@jit_compiled
def is_above_triangle(a: Vector, b: Vector, c: Vector) -> bool:
    """Return whether the origin projects into a triangle of the GJK simplex."""
    ab, ac = gjk_minus(b, a), gjk_minus(c, a)
    d1, d2 = -gjk_dot(ab, a), -gjk_dot(ac, a)
    d3, d4 = -gjk_dot(ab, b), -gjk_dot(ac, b)
    d5, d6 = -gjk_dot(ab, c), -gjk_dot(ac, c)
    return bool(d3 * d6 > d5 * d4 and d5 * d2 > d1 * d6 and d1 * d4 > d3 * d2)


@jit_compiled
def simplex_has_origin(simplex: F64) -> bool:
    """Return whether the origin is strictly inside the GJK simplex, a tetrahedron."""
    inside = True
    for skipped in range(4):
        a = simplex_corner(simplex, (skipped + 1) & 3)
        normal = gjk_cross(
            gjk_minus(simplex_corner(simplex, (skipped + 2) & 3), a),
            gjk_minus(simplex_corner(simplex, (skipped + 3) & 3), a),
        )
        to_other = gjk_dot(normal, gjk_minus(simplex_corner(simplex, skipped), a))
        inside = inside and to_other * -gjk_dot(normal, a) > 0.0
    return inside


@jit_compiled
def nearest_in_simplex(simplex: F64, count: Int) -> tuple[Vector, Int]:
    """Return the GJK simplex's point nearest to the origin, and the corners it needs, as bits.

    Faces count where the origin projects into them, edges always; the best of all is taken, so
    that slivers do no harm.
    """
    best, bits = simplex_corner(simplex, 0), 1
    if count == 4 and simplex_has_origin(simplex):
        return (0.0, 0.0, 0.0), 15
    for i in range(count):
        for j in range(i + 1, count):
            point, needed = nearest_on_simplex_edge(simplex, i, j)
            if gjk_dot(point, point) < gjk_dot(best, best):
                best, bits = point, needed
    for skipped in range(4):
        if count < 3 or (count == 3 and skipped < 3):
            continue
        i, j, k = (0 if skipped else 1), (1 if skipped > 1 else 2), (2 if skipped > 2 else 3)
        a, b, c = simplex_corner(simplex, i), simplex_corner(simplex, j), simplex_corner(simplex, k)
        if is_above_triangle(a, b, c):
            normal = gjk_cross(gjk_minus(b, a), gjk_minus(c, a))
            factor = gjk_dot(a, normal) / gjk_dot(normal, normal)
            point = (normal[0] * factor, normal[1] * factor, normal[2] * factor)
            if gjk_dot(point, point) < gjk_dot(best, best):
                best, bits = point, (1 << i) | (1 << j) | (1 << k)
    return best, bits


@jit_compiled
def keep_simplex_corners(simplex: F64, count: Int, bits: Int) -> Int:
    """Move the simplex corners named by bits to the front; return how many."""
    kept = 0
    for i in range(count):
        if bits & (1 << i):
            for axis in range(3):
                simplex[kept, axis] = simplex[i, axis]
            kept += 1
    return kept


@jit_compiled
def convex_distance(body: F64, other: F64) -> tuple[Float, Vector, Float]:
    """Return upper bound, direction and lower bound of two hulls' distance by GJK.

    body, other: (n, 3) corners, in one frame. Both bounds agree to PRECISION_M; both are 0 when
    the bodies touch, and the direction then is 0 too.
    """
    simplex = np.zeros((5, 3))
    for axis in range(3):
        simplex[0, axis] = body[0, axis] - other[0, axis]
    point, count = simplex_corner(simplex, 0), 1
    upper, lower, direction = np.sqrt(gjk_dot(point, point)), 0.0, (0.0, 0.0, 0.0)
    for _ in range(_MOST_STEPS):
        if upper <= PRECISION_M or count == 4:
            return 0.0, (0.0, 0.0, 0.0), 0.0
        toward = (point[0] / upper, point[1] / upper, point[2] / upper)
        mine = simplex_corner(body, support_corner(body, (-toward[0], -toward[1], -toward[2])))
        support = gjk_minus(mine, simplex_corner(other, support_corner(other, toward)))
        bound = gjk_dot(support, toward)
        if bound > lower:
            lower, direction = bound, toward
        if upper - lower <= PRECISION_M:
            break
        simplex[count, 0], simplex[count, 1], simplex[count, 2] = support
        point, bits = nearest_in_simplex(simplex, count + 1)
        count = keep_simplex_corners(simplex, count + 1, bits)
        upper = np.sqrt(gjk_dot(point, point))
    return upper, direction, lower


@jit_compiled
def hull_at_pose(corners: F64, position: Vector, q_wxyz: tuple[Float, Float, Float, Float]) -> F64:
    """Return the corners of a convex hull moved to a pose (GJK kernel)."""
    w, x, y, z = q_wxyz
    out = np.empty_like(corners)
    for i in range(corners.shape[0]):
        a, b, c = corners[i, 0], corners[i, 1], corners[i, 2]
        tx, ty, tz = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
        out[i, 0] = position[0] + a + w * tx + y * tz - z * ty
        out[i, 1] = position[1] + b + w * ty + z * tx - x * tz
        out[i, 2] = position[2] + c + w * tz + x * ty - y * tx
    return out


@jit_compiled
def posed_convex_distance(
    body: F64, position: Vector, q_wxyz: tuple[Float, Float, Float, Float], other: F64
) -> tuple[Float, Vector, Float]:
    """Return the GJK `convex_distance` of a body at a pose."""
    return convex_distance(hull_at_pose(body, position, q_wxyz), other)
