"""The rasteriser: from triangles in space to a visibility buffer, exact, deterministic, no gaps.

A visibility buffer (Burns and Hunt 2013) holds 1/z and the triangle of each pixel; colour is
looked up once per pixel afterwards, in shading.py. Coverage is solved in integers of 1/256 pixel
with the top-left rule, so that neighbours share no pixel and leave none out. Planes of 1/z come
from unclipped triangles in homogeneous coordinates (Olano and Greer 1997).

Camera coordinates are optical: x right, y down, z forward, metres. Pixel centres are integers.
"""

import numpy as np

from wil_campaign.worlds.jit import F64, Float, Int, jit_compiled, jit_inlined
from wil_campaign.worlds.render.arrays import (
    F32,
    I32,
    GeometryArrays,
    ScratchArrays,
    TriangleArrays,
    ViewArrays,
    VisibilityBuffer,
)
from wil_campaign.worlds.render.placing import NEAR_M

SUB_BITS = 8
SUB = 1 << SUB_BITS
Lens = tuple[Float, Float, Float, Float]
"""fx, fy, cx, cy."""
Corners = tuple[Int, Int, Int]
"""The three vertices of a face."""
Triangle = tuple[Float, Float, Float, Float, Float, Float]
"""Pixels of three corners: x, y, x, y, x, y."""
GUARD_PX = 1_000_000.0
"""How far outside of the image a triangle may reach: products then fit into 64 bits."""


@jit_inlined
def project_vertices(
    geometry: GeometryArrays, view: ViewArrays, k: Int, camera: F64, screen: F64
) -> None:
    """Write camera coordinates and pixels of object k's vertices for rasterisation."""
    m, shift, vertices = view.rotations, view.shifts, geometry.vertices
    fx, fy, cx, cy = view.fx, view.fy, view.cx, view.cy
    for i in range(geometry.vertex_range[k, 0], geometry.vertex_range[k, 1]):
        a, b, c = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        x = m[k, 0, 0] * a + m[k, 0, 1] * b + m[k, 0, 2] * c + shift[k, 0]
        y = m[k, 1, 0] * a + m[k, 1, 1] * b + m[k, 1, 2] * c + shift[k, 1]
        z = m[k, 2, 0] * a + m[k, 2, 1] * b + m[k, 2, 2] * c + shift[k, 2]
        camera[i, 0], camera[i, 1], camera[i, 2] = x, y, z
        if z >= NEAR_M:
            screen[i, 0] = fx * x / z + cx
            screen[i, 1] = fy * y / z + cy


@jit_compiled
def clip_polygon(polygon: F64, count: Int, plane: F64, out: F64) -> Int:
    """Clip a polygon to plane . (x, y, z, 1) >= 0 before rasterisation; return its corners."""
    kept = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        a = plane[0] * polygon[i, 0] + plane[1] * polygon[i, 1] + plane[2] * polygon[i, 2]
        b = plane[0] * polygon[j, 0] + plane[1] * polygon[j, 1] + plane[2] * polygon[j, 2]
        a, b = a + plane[3], b + plane[3]
        if a >= 0.0:
            for c in range(3):
                out[kept, c] = polygon[i, c]
            kept += 1
        if (a >= 0.0) != (b >= 0.0):
            t = a / (a - b)
            for c in range(3):
                out[kept, c] = polygon[i, c] + t * (polygon[j, c] - polygon[i, c])
            kept += 1
    return kept


@jit_inlined
def clip_triangle(camera: F64, abc: Corners, lens: Lens, work: F64) -> Int:
    """Write pixels of a triangle clipped to near plane and guard band.

    work: (3, 10, 3); the pixels come to work[2]. Returns the number of corners, 0 for none.
    """
    fx, fy, cx, cy = lens
    polygon, other = work[0], work[1]
    for i in range(3):
        for axis in range(3):
            polygon[i, axis] = camera[abc[i], axis]
    plane = np.empty(4)
    plane[0], plane[1], plane[2], plane[3] = 0.0, 0.0, 1.0, -NEAR_M
    count = clip_polygon(polygon, 3, plane, other)
    for axis in range(2):
        for sign in (-1.0, 1.0):
            if count < 3:
                return 0
            polygon, other = other, polygon
            plane[0], plane[1], plane[2], plane[3] = 0.0, 0.0, 0.9 * GUARD_PX, 0.0
            plane[axis] = sign * (fx if axis == 0 else fy)
            count = clip_polygon(polygon, count, plane, other)
    for i in range(count):
        z = max(other[i, 2], NEAR_M)
        work[2, i, 0] = fx * other[i, 0] / z + cx
        work[2, i, 1] = fy * other[i, 1] / z + cy
    return count if count >= 3 else 0


@jit_inlined
def depth_plane(camera: F64, abc: Corners, lens: Lens) -> tuple[Float, Float, Float]:
    """Return the plane of 1/z over pixels (at the origin, per column, per row); 0s edge-on."""
    fx, fy, cx, cy = lens
    a, b, c = abc
    ax, ay, az = camera[a, 0], camera[a, 1], camera[a, 2]
    ux, uy, uz = camera[b, 0] - ax, camera[b, 1] - ay, camera[b, 2] - az
    vx, vy, vz = camera[c, 0] - ax, camera[c, 1] - ay, camera[c, 2] - az
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    distance = nx * ax + ny * ay + nz * az
    if distance == 0.0:
        return 0.0, 0.0, 0.0
    per_column, per_row = nx / (fx * distance), ny / (fy * distance)
    return nz / distance - per_column * cx - per_row * cy, per_column, per_row


@jit_compiled
def store_triangle(
    corners: I32, bounds: I32, n: Int, pixels: Triangle, size: tuple[Int, Int], one_sided: bool
) -> bool:
    """Store corners and bounds of the n-th triangle; False when it covers no pixel centre.

    It is turned so that each edge has the inside on the same side. one_sided: backs are hidden.
    """
    ax, ay = np.int64(np.floor(pixels[0] * SUB + 0.5)), np.int64(np.floor(pixels[1] * SUB + 0.5))
    bx, by = np.int64(np.floor(pixels[2] * SUB + 0.5)), np.int64(np.floor(pixels[3] * SUB + 0.5))
    cx, cy = np.int64(np.floor(pixels[4] * SUB + 0.5)), np.int64(np.floor(pixels[5] * SUB + 0.5))
    left: Int = max(0, (min(ax, bx, cx) + SUB - 1) >> SUB_BITS)
    right: Int = min(size[0] - 1, max(ax, bx, cx) >> SUB_BITS)
    top: Int = max(0, (min(ay, by, cy) + SUB - 1) >> SUB_BITS)
    bottom: Int = min(size[1] - 1, max(ay, by, cy) >> SUB_BITS)
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    if area == 0 or left > right or top > bottom or (one_sided and area > 0):
        return False
    if area < 0:
        bx, by, cx, cy = cx, cy, bx, by
    corners[n, 0], corners[n, 1], corners[n, 2] = ax, ay, bx
    corners[n, 3], corners[n, 4], corners[n, 5] = by, cx, cy
    bounds[n, 0], bounds[n, 1], bounds[n, 2], bounds[n, 3] = left, right, top, bottom
    return True


@jit_inlined
def finish_triangle(
    triangles: TriangleArrays, n: Int, f: Int, camera: F64, abc: Corners, lens: Lens
) -> Int:
    """Store depth and face of the n-th triangle for coverage; return the next free index."""
    at_origin, per_column, per_row = depth_plane(camera, abc, lens)
    if at_origin == 0.0 and per_column == 0.0 and per_row == 0.0:
        return n
    a, b, c = abc
    far: Float = max(camera[a, 2], camera[b, 2], camera[c, 2])
    near: Float = max(min(camera[a, 2], camera[b, 2], camera[c, 2]), NEAR_M)
    planes = triangles.planes
    planes[n, 0], planes[n, 1], planes[n, 2] = at_origin, per_column, per_row
    triangles.depth_range[n, 0] = np.float32(1.0 / far)
    triangles.depth_range[n, 1] = np.float32(1.0 / near)
    triangles.face[n] = f
    return n + 1


@jit_compiled
def is_unclipped(camera: F64, screen: F64, abc: Corners) -> bool:
    """Return whether a triangle needs no clipping."""
    a, b, c = abc
    return bool(
        min(camera[a, 2], camera[b, 2], camera[c, 2]) >= NEAR_M
        and min(screen[a, 0], screen[b, 0], screen[c, 0]) > -GUARD_PX
        and max(screen[a, 0], screen[b, 0], screen[c, 0]) < GUARD_PX
        and min(screen[a, 1], screen[b, 1], screen[c, 1]) > -GUARD_PX
        and max(screen[a, 1], screen[b, 1], screen[c, 1]) < GUARD_PX
    )


@jit_inlined
def gather_face(
    face: tuple[Int, bool, Corners],
    vertices: tuple[F64, F64],
    view: ViewArrays,
    triangles: TriangleArrays,
    n: Int,
    work: F64,
) -> Int:
    """Store the triangles of a face that may cover pixels, from n on; return the next index."""
    camera, screen = vertices
    f, one_sided, abc = face
    lens, size = (view.fx, view.fy, view.cx, view.cy), (view.width, view.height)
    count = 3
    if is_unclipped(camera, screen, abc):
        for i in range(3):
            work[2, i, 0], work[2, i, 1] = screen[abc[i], 0], screen[abc[i], 1]
    else:
        count = clip_triangle(camera, abc, lens, work)
    for i in range(2, count):
        pixels = (
            work[2, 0, 0],
            work[2, 0, 1],
            work[2, i - 1, 0],
            work[2, i - 1, 1],
            work[2, i, 0],
            work[2, i, 1],
        )
        if store_triangle(triangles.corners, triangles.bounds, n, pixels, size, one_sided):
            n = finish_triangle(triangles, n, f, camera, abc, lens)
    return n


@jit_compiled
def gather_triangles(geometry: GeometryArrays, view: ViewArrays, scratch: ScratchArrays) -> Int:
    """Store every triangle that may cover pixels; return the count, or -1 when out of room."""
    n, work, faces = np.int64(0), np.empty((3, 10, 3)), geometry.faces
    vertices = (scratch.camera, scratch.screen)
    room = scratch.triangles.corners.shape[0] - 8
    for k in range(geometry.face_range.shape[0]):
        if view.shown[k] == 0:
            continue
        project_vertices(geometry, view, k, scratch.camera, scratch.screen)
        for f in range(geometry.face_range[k, 0], geometry.face_range[k, 1]):
            if n > room:
                return np.int64(-1)
            abc = (faces[f, 0], faces[f, 1], faces[f, 2])
            n = gather_face(
                (f, view.one_sided[k] != 0, abc), vertices, view, scratch.triangles, n, work
            )
    return n


@jit_compiled
def floor_divide(a: Int, b: Int, inverse: Float) -> Int:
    """Return a / b rounded down, b > 0, from an approximate 1 / b; exact for pixel spans."""
    quotient = np.int64(np.floor(a * inverse))
    rest = a - quotient * b
    if rest < 0:
        quotient -= 1
    elif rest >= b:
        quotient += 1
    return quotient


@jit_compiled
def narrow_span(left: Int, right: Int, value: Int, drop: Int, inverse: Float) -> tuple[Int, Int]:
    """Return the columns of a pixel span inside an edge; value: E at column 0, E falls by drop."""
    if drop > 0:
        return left, min(right, floor_divide(value, drop, inverse))
    if drop < 0:
        return max(left, -floor_divide(value, -drop, inverse)), right
    return left, right if value >= 0 else -1


@jit_compiled
def edge_function(
    corners: I32, t: Int, from_corner: Int, to_corner: Int
) -> tuple[Int, Int, Int, Float]:
    """Return the edge function of triangle t: E at the origin, rise per row, drop per column.

    From (xa, ya) to (xb, yb), E = (xb - xa)(y - ya) - (yb - ya)(x - xa) is at least 0 inside;
    a pixel on an edge belongs to the triangle whose top or left edge it is.
    """
    xa, ya = np.int64(corners[t, 2 * from_corner]), np.int64(corners[t, 2 * from_corner + 1])
    xb, yb = np.int64(corners[t, 2 * to_corner]), np.int64(corners[t, 2 * to_corner + 1])
    run, drop = xb - xa, yb - ya
    owned = drop < 0 or (drop == 0 and run > 0)
    value = drop * xa - run * ya - (0 if owned else 1)
    inverse = 1.0 / (SUB * abs(drop)) if drop != 0 else 0.0
    return value, run * SUB, drop * SUB, inverse


@jit_compiled
def rasterize_triangles(
    corners: I32, bounds: I32, planes: F64, depth_range: F32, count: Int, buffer: VisibilityBuffer
) -> None:
    """Rasterise all triangles: each wins the pixels of the buffer where it is nearest."""
    inverse_depth, owner, width = buffer
    for t in range(count):
        low, high = np.int64(bounds[t, 0]), np.int64(bounds[t, 1])
        value_a, rise_a, drop_a, inverse_a = edge_function(corners, t, 0, 1)
        value_b, rise_b, drop_b, inverse_b = edge_function(corners, t, 1, 2)
        value_c, rise_c, drop_c, inverse_c = edge_function(corners, t, 2, 0)
        step, least, most = planes[t, 1], depth_range[t, 0], depth_range[t, 1]
        for y in range(bounds[t, 2], bounds[t, 3] + 1):
            left, right = narrow_span(low, high, value_a + rise_a * y, drop_a, inverse_a)
            left, right = narrow_span(left, right, value_b + rise_b * y, drop_b, inverse_b)
            left, right = narrow_span(left, right, value_c + rise_c * y, drop_c, inverse_c)
            w = planes[t, 0] + planes[t, 2] * y + step * left
            # Unsigned places: Numba then leaves out what negative indices would mean.
            start = np.uint64(y * width + left)
            for i in range(np.int32(right - left + 1)):
                here = min(max(np.float32(w + step * i), least), most)
                at = start + np.uint64(i)
                nearer = here > inverse_depth[at]
                owner[at] = t if nearer else owner[at]
                inverse_depth[at] = here if nearer else inverse_depth[at]
