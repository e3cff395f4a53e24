"""From a visibility buffer to colour, depth and ids: each pixel is shaded once.

Light: ambient, a lamp (Lambert) and a little more from above than from below; a face is lit on
the side that is seen. Textures: nearest texel of the mip level that fits.
"""

import numpy as np

from worlds.render.arrays import U8, Geometry, Looks, Run, Scratch, Target, View
from worlds.render.coverage import cover, gather
from worlds.render.jit import compiled

AMBIENT, LAMP, SKY = 0.60, 0.36, 0.10
_PLAIN, _TEXTURED, _SMOOTH = 1, 2, 3
_CHUNK_PX = 32
_SHARPNESS = 1.4
"""How many texels a pixel may skip before a coarser level is taken."""


@compiled
def vertex_shade(geometry: Geometry, view: View, k: int, v: int, side: float) -> float:
    """Return the brightness of a vertex of object k, 0 to 256; side: -1 for a back."""
    n, light = geometry.normals[v], view.lights[k]
    lamp = side * (n[0] * light[0, 0] + n[1] * light[0, 1] + n[2] * light[0, 2])
    up = side * (n[0] * light[1, 0] + n[1] * light[1, 1] + n[2] * light[1, 2])
    return 256.0 * min(1.0, AMBIENT + LAMP * max(0.0, lamp) + SKY * up)


@compiled
def prepare_face(geometry: Geometry, looks: Looks, view: View, scratch: Scratch, f: int) -> None:
    """Work out how a face is shaded: brightness, and planes of shade, u and v over z."""
    a, b, c = geometry.faces[f, 0], geometry.faces[f, 1], geometry.faces[f, 2]
    p, q, r = scratch.camera[a], scratch.camera[b], scratch.camera[c]
    qr = (q[1] * r[2] - q[2] * r[1], q[2] * r[0] - q[0] * r[2], q[0] * r[1] - q[1] * r[0])
    rp = (r[1] * p[2] - r[2] * p[1], r[2] * p[0] - r[0] * p[2], r[0] * p[1] - r[1] * p[0])
    pq = (p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0])
    volume = p[0] * qr[0] + p[1] * qr[1] + p[2] * qr[2]
    side, k = (1.0 if volume < 0.0 else -1.0), geometry.face_object[f]
    sa = vertex_shade(geometry, view, k, a, side)
    sb = vertex_shade(geometry, view, k, b, side)
    sc = vertex_shade(geometry, view, k, c, side)
    flat = max(abs(sa - sb), abs(sa - sc)) < 0.5
    textured = looks.texture[geometry.face_material[f]] >= 0
    scratch.face_shade[f] = np.int32(sa)
    scratch.face_state[f] = 1 + (1 if textured else 0) + (0 if flat else 2)
    uv = geometry.uv
    values = ((sa, sb, sc), (uv[a, 0], uv[b, 0], uv[c, 0]), (uv[a, 1], uv[b, 1], uv[c, 1]))
    out = scratch.attributes[f]
    for i in range(3):
        va, vb, vc = values[i]
        x = (va * qr[0] + vb * rp[0] + vc * pq[0]) / (volume * view.fx)
        y = (va * qr[1] + vb * rp[1] + vc * pq[1]) / (volume * view.fy)
        z = (va * qr[2] + vb * rp[2] + vc * pq[2]) / volume
        out[3 * i], out[3 * i + 1], out[3 * i + 2] = z - x * view.cx - y * view.cy, x, y


@compiled
def paint_background(looks: Looks, view: View, y: int, left: int, out: U8) -> None:
    """Paint sky and ground by elevation, from column `left` of row y."""
    up = view.up
    level = up[2] + up[1] * (y - view.cy) / view.fy + up[0] * (left - view.cx) / view.fx
    step = up[0] / view.fx
    for i in range(out.shape[0]):
        place = min(max((level + step * i) * 256.0 + 256.0, 0.0), 511.0)
        color = looks.background[np.int32(place)]
        out[i, 0], out[i, 1], out[i, 2] = color & 255, (color >> 8) & 255, (color >> 16) & 255


@compiled
def paint_plain(color: int, shade: int, out: U8) -> None:
    """Paint a run in one colour."""
    blue = np.uint8(((color & 255) * shade) >> 8)
    green = np.uint8((((color >> 8) & 255) * shade) >> 8)
    red = np.uint8((((color >> 16) & 255) * shade) >> 8)
    for i in range(out.shape[0]):
        out[i, 0], out[i, 1], out[i, 2] = blue, green, red


@compiled
def paint_smooth(color: int, values: Run, out: U8) -> None:
    """Paint a run in one colour whose brightness varies."""
    blue, green, red = color & 255, (color >> 8) & 255, (color >> 16) & 255
    for i in range(out.shape[0]):
        bright = (values.shade + values.shade_step * i) / (values.w + values.w_step * i)
        shade = np.int32(min(max(bright, 0.0), 256.0))
        out[i, 0], out[i, 1], out[i, 2] = (
            np.uint8((blue * shade) >> 8),
            np.uint8((green * shade) >> 8),
            np.uint8((red * shade) >> 8),
        )


@compiled
def mip_level(looks: Looks, texture: int, z: float, run: Run, i: int) -> int:
    """Return the mip level whose texels are about as large as pixel i of a run."""
    wide, high = 1 << looks.log2_width[texture], 1 << looks.log2_height[texture]
    u, v = (run.u + run.u_step * i) * z, (run.v + run.v_step * i) * z
    across = max(abs(run.u_step - u * run.w_step) * wide, abs(run.v_step - v * run.w_step) * high)
    along = max(abs(run.u_down - u * run.w_down) * wide, abs(run.v_down - v * run.w_down) * high)
    footprint, level = max(across, along) * z, 0
    while footprint > _SHARPNESS and level + 1 < looks.mip_count[texture]:
        footprint *= 0.5
        level += 1
    return level


@compiled
def paint_textured(looks: Looks, texture: int, shade: int, run: Run, out: U8) -> None:
    """Paint a textured run; shade below 0: brightness varies."""
    flat = np.int32(shade)
    for start in range(0, out.shape[0], _CHUNK_PX):
        end = min(start + _CHUNK_PX, out.shape[0])
        middle = (start + end) >> 1
        z = 1.0 / (run.w + run.w_step * middle)
        level = mip_level(looks, texture, z, run, middle)
        first = looks.mip_start[texture, level]
        wide = max(0, looks.log2_width[texture] - level)
        columns, rows = 1 << wide, 1 << max(0, looks.log2_height[texture] - level)
        piece = out[start:end]
        for j in range(piece.shape[0]):
            i = start + j
            z = 1.0 / (run.w + run.w_step * i)
            column = np.int32((run.u + run.u_step * i) * z * columns) & (columns - 1)
            row = np.int32((run.v + run.v_step * i) * z * rows) & (rows - 1)
            texel = looks.texels[first + (row << wide) + column]
            bright = flat
            if flat < 0:
                bright = np.int32(min(max((run.shade + run.shade_step * i) * z, 0.0), 256.0))
            piece[j, 0] = np.uint8(((texel & 255) * bright) >> 8)
            piece[j, 1] = np.uint8((((texel >> 8) & 255) * bright) >> 8)
            piece[j, 2] = np.uint8((((texel >> 16) & 255) * bright) >> 8)


@compiled
def start_run(scratch: Scratch, t: int, f: int, y: int, left: int) -> Run:
    """Return what varies along a run of triangle t from column `left` of row y."""
    plane, a = scratch.planes[t], scratch.attributes[f]
    return Run(
        plane[0] + plane[2] * y + plane[1] * left,
        plane[1],
        plane[2],
        a[0] + a[2] * y + a[1] * left,
        a[1],
        a[3] + a[5] * y + a[4] * left,
        a[4],
        a[5],
        a[6] + a[8] * y + a[7] * left,
        a[7],
        a[8],
    )


@compiled
def paint_run(
    geometry: Geometry,
    looks: Looks,
    view: View,
    scratch: Scratch,
    t: int,
    y: int,
    left: int,
    out: U8,
) -> None:
    """Paint a run of pixels of triangle t."""
    f = scratch.triangle_face[t]
    if scratch.face_state[f] == 0:
        prepare_face(geometry, looks, view, scratch, f)
    state, material = scratch.face_state[f], geometry.face_material[f]
    if state == _PLAIN:
        paint_plain(np.int32(looks.bgr[material]), scratch.face_shade[f], out)
        return
    run = start_run(scratch, t, f, y, left)
    if state == _SMOOTH:
        paint_smooth(np.int32(looks.bgr[material]), run, out)
    else:
        shade = scratch.face_shade[f] if state == _TEXTURED else -1
        paint_textured(looks, looks.texture[material], shade, run, out)


@compiled
def shade_row(
    geometry: Geometry, looks: Looks, view: View, scratch: Scratch, target: Target, y: int, row: int
) -> None:
    """Give row y of the picture its colours, depths and ids, run by run."""
    owner, width = scratch.triangle[row], scratch.triangle.shape[1]
    left = 0
    while left < width:
        t, right = owner[left], left + 1
        while right < width and owner[right] == t:
            right += 1
        out = target.image[y, left:right]
        if t < 0:
            paint_background(looks, view, y, left, out)
        else:
            paint_run(geometry, looks, view, scratch, t, y, left, out)
        if target.want_ids:
            name = np.uint8(0)
            if t >= 0:
                name = looks.object_ids[geometry.face_object[scratch.triangle_face[t]]]
            target.ids[y, left:right] = name
        left = right
    if target.want_depth:
        depth, inverse = target.depth[y], scratch.inverse_depth[row]
        for x in range(depth.shape[0]):
            depth[x] = np.float32(1.0) / inverse[x]


@compiled
def draw(geometry: Geometry, looks: Looks, view: View, scratch: Scratch, target: Target) -> bool:
    """Draw a picture; False when the scratch has no room for all triangles."""
    height, width = target.image.shape[0], target.image.shape[1]
    count = gather(geometry, view, scratch, width, height)
    if count < 0:
        return False
    scratch.face_state[:] = 0
    band = scratch.triangle.shape[0]
    for top in range(0, height, band):
        bottom = min(top + band, height)
        scratch.inverse_depth[:] = 0.0
        scratch.triangle[:] = -1
        cover(scratch, count, top, bottom, width)
        for y in range(top, bottom):
            shade_row(geometry, looks, view, scratch, target, y, y - top)
    return True
