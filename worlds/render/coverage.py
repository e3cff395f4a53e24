"""From triangles in space to a visibility buffer: exact, deterministic, with no gaps.

A visibility buffer (Burns and Hunt 2013) holds 1/z and the triangle of each pixel; colour is
looked up once per pixel afterwards, in shading.py. Coverage is solved in integers of 1/256 pixel
with the top-left rule, so that neighbours share no pixel and leave none out. Planes of 1/z come
from unclipped triangles in homogeneous coordinates (Olano and Greer 1997).

Camera coordinates are optical: x right, y down, z forward, metres. Pixel centres are integers.
"""

import numpy as np

from worlds.render.arrays import F64, Geometry, Scratch, View
from worlds.render.jit import compiled

NEAR_M = 0.05
SUB = 256
GUARD_PX = 1_000_000.0
"""How far outside of the picture a triangle may reach: products then fit into 64 bits."""


@compiled
def sphere_shows(sphere: F64, view: View, k: int, width: int, height: int) -> bool:
    """Return whether the bounding sphere of object k may reach into the picture."""
    m, shift = view.rotations[k], view.shifts[k]
    x = m[0, 0] * sphere[0] + m[0, 1] * sphere[1] + m[0, 2] * sphere[2] + shift[0]
    y = m[1, 0] * sphere[0] + m[1, 1] * sphere[1] + m[1, 2] * sphere[2] + shift[1]
    z = m[2, 0] * sphere[0] + m[2, 1] * sphere[1] + m[2, 2] * sphere[2] + shift[2]
    left, right = view.cx + 0.5, width - 0.5 - view.cx
    top, bottom = view.cy + 0.5, height - 0.5 - view.cy
    fx, fy, r = view.fx, view.fy, sphere[3]
    return (
        z + r > NEAR_M
        and fx * x + left * z > -r * np.hypot(fx, left)
        and right * z - fx * x > -r * np.hypot(fx, right)
        and fy * y + top * z > -r * np.hypot(fy, top)
        and bottom * z - fy * y > -r * np.hypot(fy, bottom)
    )


@compiled
def project_vertices(geometry: Geometry, view: View, k: int, scratch: Scratch) -> None:
    """Write camera coordinates and pixels of object k's vertices."""
    m, shift = view.rotations[k], view.shifts[k]
    vertices, camera, screen = geometry.vertices, scratch.camera, scratch.screen
    for i in range(geometry.vertex_range[k, 0], geometry.vertex_range[k, 1]):
        a, b, c = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        x = m[0, 0] * a + m[0, 1] * b + m[0, 2] * c + shift[0]
        y = m[1, 0] * a + m[1, 1] * b + m[1, 2] * c + shift[1]
        z = m[2, 0] * a + m[2, 1] * b + m[2, 2] * c + shift[2]
        camera[i, 0], camera[i, 1], camera[i, 2] = x, y, z
        if z >= NEAR_M:
            screen[i, 0] = view.fx * x / z + view.cx
            screen[i, 1] = view.fy * y / z + view.cy


@compiled
def clip(polygon: F64, count: int, plane: F64, out: F64) -> int:
    """Write the part of a polygon where plane . (x, y, z, 1) >= 0; return its corners."""
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


@compiled
def clipped_polygon(scratch: Scratch, a: int, b: int, c: int, view: View, work: F64) -> int:
    """Write pixels of a triangle's part before the near plane and within the guard band.

    work: (3, 10, 3); the pixels come to work[2]. Returns the number of corners, 0 for none.
    """
    polygon, other = work[0], work[1]
    for i in range(3):
        polygon[0, i] = scratch.camera[a, i]
        polygon[1, i] = scratch.camera[b, i]
        polygon[2, i] = scratch.camera[c, i]
    plane = np.zeros(4)
    plane[2], plane[3] = 1.0, -NEAR_M
    count = clip(polygon, 3, plane, other)
    plane[3] = 0.0
    for axis in range(2):
        focal = view.fx if axis == 0 else view.fy
        for sign in (-1.0, 1.0):
            if count < 3:
                return 0
            polygon, other = other, polygon
            plane[0], plane[1], plane[2] = 0.0, 0.0, 0.9 * GUARD_PX
            plane[axis] = sign * focal
            count = clip(polygon, count, plane, other)
    for i in range(count):
        z = max(other[i, 2], NEAR_M)
        work[2, i, 0] = view.fx * other[i, 0] / z + view.cx
        work[2, i, 1] = view.fy * other[i, 1] / z + view.cy
        work[2, i, 2] = z
    return count if count >= 3 else 0


@compiled
def depth_plane(scratch: Scratch, a: int, b: int, c: int, view: View, out: F64) -> bool:
    """Write the plane of 1/z over pixels of a triangle; False when it is seen edge-on."""
    p = scratch.camera
    ux, uy, uz = p[b, 0] - p[a, 0], p[b, 1] - p[a, 1], p[b, 2] - p[a, 2]
    vx, vy, vz = p[c, 0] - p[a, 0], p[c, 1] - p[a, 1], p[c, 2] - p[a, 2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    distance = nx * p[a, 0] + ny * p[a, 1] + nz * p[a, 2]
    if distance == 0.0:
        return False
    out[1] = nx / (view.fx * distance)
    out[2] = ny / (view.fy * distance)
    out[0] = nz / distance - out[1] * view.cx - out[2] * view.cy
    return True


@compiled
def emit(
    scratch: Scratch, n: int, pixels: F64, near: float, far: float, size: tuple[int, int]
) -> int:
    """Store one triangle, pixels (3, 2), its plane already at n; return the next free place."""
    width, height = size
    low_x = min(pixels[0, 0], pixels[1, 0], pixels[2, 0])
    high_x = max(pixels[0, 0], pixels[1, 0], pixels[2, 0])
    low_y = min(pixels[0, 1], pixels[1, 1], pixels[2, 1])
    high_y = max(pixels[0, 1], pixels[1, 1], pixels[2, 1])
    if high_x < -1.0 or low_x > width or high_y < -1.0 or low_y > height:
        return n
    corners = scratch.corners
    for i in range(3):
        corners[n, 2 * i] = np.int32(np.floor(pixels[i, 0] * SUB + 0.5))
        corners[n, 2 * i + 1] = np.int32(np.floor(pixels[i, 1] * SUB + 0.5))
    ax, ay = np.int64(corners[n, 0]), np.int64(corners[n, 1])
    bx, by = np.int64(corners[n, 2]), np.int64(corners[n, 3])
    cx, cy = np.int64(corners[n, 4]), np.int64(corners[n, 5])
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    if area == 0:
        return n
    if area < 0:
        corners[n, 2], corners[n, 3], corners[n, 4], corners[n, 5] = cx, cy, bx, by
    scratch.depth_range[n, 0] = np.float32(1.0 / far)
    scratch.depth_range[n, 1] = np.float32(1.0 / near)
    return n + 1


@compiled
def gather(geometry: Geometry, view: View, scratch: Scratch, width: int, height: int) -> int:
    """Store every triangle that may show; return how many, or -1 when there is no room."""
    n = 0
    work, pixels = np.empty((3, 10, 3)), np.empty((3, 2))
    plane = np.empty(3)
    camera, screen = scratch.camera, scratch.screen
    capacity = scratch.corners.shape[0] - 10
    for k in range(geometry.spheres.shape[0]):
        if view.shown[k] == 0 or not sphere_shows(geometry.spheres[k], view, k, width, height):
            continue
        project_vertices(geometry, view, k, scratch)
        for f in range(geometry.face_range[k, 0], geometry.face_range[k, 1]):
            a, b, c = geometry.faces[f, 0], geometry.faces[f, 1], geometry.faces[f, 2]
            near = min(camera[a, 2], camera[b, 2], camera[c, 2])
            far = max(camera[a, 2], camera[b, 2], camera[c, 2])
            if far < NEAR_M or not depth_plane(scratch, a, b, c, view, plane):
                continue
            if n >= capacity:
                return -1
            inside = near >= NEAR_M
            if inside:
                for i, v in enumerate((a, b, c)):
                    pixels[i, 0], pixels[i, 1] = screen[v, 0], screen[v, 1]
                    inside = (
                        inside and abs(screen[v, 0]) < GUARD_PX and abs(screen[v, 1]) < GUARD_PX
                    )
            count = 3 if inside else clipped_polygon(scratch, a, b, c, view, work)
            for last in range(2, count):
                if not inside:
                    for i, v in enumerate((0, last - 1, last)):
                        pixels[i, 0], pixels[i, 1] = work[2, v, 0], work[2, v, 1]
                scratch.planes[n, 0], scratch.planes[n, 1] = plane[0], plane[1]
                scratch.planes[n, 2] = plane[2]
                scratch.triangle_face[n] = f
                n = emit(scratch, n, pixels, max(near, NEAR_M), far, (width, height))
    return n


@compiled
def ceil_div(a: int, b: int) -> int:
    """Return a / b rounded up; b > 0."""
    return -((-a) // b)


@compiled
def cover(scratch: Scratch, count: int, top: int, bottom: int, width: int) -> None:
    """Fill the visibility buffer for rows top to bottom - 1, its first row being `top`.

    An edge from (xa, ya) to (xb, yb) has E = (xb - xa)(y - ya) - (yb - ya)(x - xa), positive
    inside; a pixel on it belongs to the triangle whose top or left edge it is.
    """
    corners, planes = scratch.corners, scratch.planes
    slope, rise, value = np.empty(3, np.int64), np.empty(3, np.int64), np.empty(3, np.int64)
    for t in range(count):
        low = min(corners[t, 1], corners[t, 3], corners[t, 5])
        high = max(corners[t, 1], corners[t, 3], corners[t, 5])
        first = max(top, ceil_div(low, SUB))
        last = min(bottom - 1, high // SUB)
        if first > last:
            continue
        low = min(corners[t, 0], corners[t, 2], corners[t, 4])
        high = max(corners[t, 0], corners[t, 2], corners[t, 4])
        leftmost = max(0, ceil_div(low, SUB))
        rightmost = min(width - 1, high // SUB)
        if leftmost > rightmost:
            continue
        for e in range(3):
            g = e + 1 if e < 2 else 0
            xa, ya = np.int64(corners[t, 2 * e]), np.int64(corners[t, 2 * e + 1])
            xb, yb = np.int64(corners[t, 2 * g]), np.int64(corners[t, 2 * g + 1])
            run, drop = xb - xa, yb - ya
            owned = drop < 0 or (drop == 0 and run > 0)
            slope[e], rise[e] = run * SUB, drop * SUB
            value[e] = run * (first * SUB - ya) + drop * xa - (0 if owned else 1)
        for y in range(first, last + 1):
            left, right = leftmost, rightmost
            for e in range(3):
                if rise[e] > 0:
                    right = min(right, value[e] // rise[e])
                elif rise[e] < 0:
                    left = max(left, ceil_div(-value[e], -rise[e]))
                elif value[e] < 0:
                    right = -1
                value[e] += slope[e]
            if left <= right:
                fill_span(scratch, t, y - top, left, right, planes[t, 0] + planes[t, 2] * y)


@compiled
def fill_span(scratch: Scratch, t: int, row: int, left: int, right: int, w: float) -> None:
    """Let a triangle win the pixels of a span where it is nearer; w: 1/z at column 0."""
    depth = scratch.inverse_depth[row, left : right + 1]
    owner = scratch.triangle[row, left : right + 1]
    step = scratch.planes[t, 1]
    least, most = scratch.depth_range[t, 0], scratch.depth_range[t, 1]
    w += step * left
    for i in range(depth.shape[0]):
        here = min(max(np.float32(w + step * i), least), most)
        nearer = here > depth[i]
        owner[i] = t if nearer else owner[i]
        depth[i] = here if nearer else depth[i]
