"""From a visibility buffer to colour, depth and ids: each pixel is shaded once.

Light: ambient, a lamp (Lambert) and a little more from above than from below; a face is lit on
the side that is seen. Textures: nearest texel of the mip level that fits. Pixels are worked on
in runs of one triangle along a row; colours are packed as 0x00rrggbb until a frame is complete.

Indices are unsigned where it counts: Numba then leaves out what negative indices would mean.
"""

import numpy as np

from wil_campaign.worlds.jit import F64, Float, Int, jit_compiled, jit_inlined
from wil_campaign.worlds.render.arrays import (
    F32,
    I32,
    U8,
    U32,
    GeometryArrays,
    LookArrays,
    ScratchArrays,
    ShadeArrays,
    ViewArrays,
)

AMBIENT, LAMP, SKY = 0.62, 0.34, 0.08
_PLAIN, _TEXTURED, _SMOOTH = 1, 2, 3
_SMOOTH_FROM = 1.5
"""Faces whose corners differ by less in brightness (of 256) are painted flat."""
_CHUNK_PX = 32
_SHARPNESS = 1.4
"""How many texels a pixel may skip before a coarser level is taken."""

Run = tuple[Int, Int, Int]
"""Row, first column, number of pixels."""


@jit_compiled
def shade_vertex(geometry: GeometryArrays, view: ViewArrays, k: Int, v: Int, side: Float) -> Float:
    """Return the shaded brightness of a vertex of object k, 0 to 256; side: -1 for a back."""
    n, light = geometry.normals, view.lights
    lamp = n[v, 0] * light[k, 0, 0] + n[v, 1] * light[k, 0, 1] + n[v, 2] * light[k, 0, 2]
    up = n[v, 0] * light[k, 1, 0] + n[v, 1] * light[k, 1, 1] + n[v, 2] * light[k, 1, 2]
    return 256.0 * min(1.0, AMBIENT + LAMP * max(0.0, side * lamp) + SKY * side * up)


@jit_inlined
def prepare_face(
    geometry: GeometryArrays,
    looks: LookArrays,
    view: ViewArrays,
    camera: F64,
    shades: ShadeArrays,
    f: Int,
) -> None:
    """Compute a face's shading: brightness, and planes of shade, u and v over z."""
    a, b, c = geometry.faces[f, 0], geometry.faces[f, 1], geometry.faces[f, 2]
    px, py, pz = camera[a, 0], camera[a, 1], camera[a, 2]
    qx, qy, qz = camera[b, 0], camera[b, 1], camera[b, 2]
    rx, ry, rz = camera[c, 0], camera[c, 1], camera[c, 2]
    qr = (qy * rz - qz * ry, qz * rx - qx * rz, qx * ry - qy * rx)
    rp = (ry * pz - rz * py, rz * px - rx * pz, rx * py - ry * px)
    pq = (py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx)
    volume = px * qr[0] + py * qr[1] + pz * qr[2]
    side, k = (1.0 if volume < 0.0 else -1.0), geometry.face_object[f]
    sa = shade_vertex(geometry, view, k, a, side)
    sb = shade_vertex(geometry, view, k, b, side)
    sc = shade_vertex(geometry, view, k, c, side)
    flat = max(abs(sa - sb), abs(sa - sc), abs(sb - sc)) < _SMOOTH_FROM
    textured = looks.texture[geometry.face_material[f]] >= 0
    shades.shade[f] = np.int32((sa + sb + sc) / 3.0 + 0.5)
    shades.state[f] = (1 if flat else 3) + (1 if textured else 0)
    if flat and not textured:
        return
    uv = geometry.uv
    values = ((sa, sb, sc), (uv[a, 0], uv[b, 0], uv[c, 0]), (uv[a, 1], uv[b, 1], uv[c, 1]))
    for i in range(3):
        va, vb, vc = values[i]
        x = (va * qr[0] + vb * rp[0] + vc * pq[0]) / (volume * view.fx)
        y = (va * qr[1] + vb * rp[1] + vc * pq[1]) / (volume * view.fy)
        z = (va * qr[2] + vb * rp[2] + vc * pq[2]) / volume
        shades.planes[f, 3 * i] = z - x * view.cx - y * view.cy
        shades.planes[f, 3 * i + 1] = x
        shades.planes[f, 3 * i + 2] = y


@jit_compiled
def dimmed_color(color: Int, shade: Int) -> Int:
    """Return a packed colour at a brightness of shade / 256."""
    red_blue = (np.uint32(color & 0xFF00FF) * np.uint32(shade)) >> 8
    green = np.uint32((color >> 8) & 0xFF) * np.uint32(shade)
    return np.uint32((red_blue & 0xFF00FF) | (green & 0xFF00))


@jit_inlined
def shade_plain_run(color: Int, start: Int, count: Int, colors: U32) -> None:
    """Shade a run of pixels in one colour."""
    for i in range(count):
        colors[np.uint64(start) + np.uint64(i)] = color


@jit_inlined
def shade_background(background: U32, view: ViewArrays, run: Run, start: Int, colors: U32) -> None:
    """Shade background pixels by elevation: sky and ground."""
    row, left, count = run
    up = view.up
    level = up[2] + up[1] * (row - view.cy) / view.fy + up[0] * (left - view.cx) / view.fx
    first, step = np.float32(level * 256.0 + 256.0), np.float32(up[0] / view.fx * 256.0)
    for i in range(np.int32(count)):
        place = min(max(first + step * np.float32(i), np.float32(0.0)), np.float32(511.0))
        colors[np.uint64(start) + np.uint64(i)] = background[np.uint64(np.int32(place))]


@jit_compiled
def shading_plane_along(planes: F64, f: Int, which: Int, run: Run) -> tuple[Float, Float]:
    """Return one of a face's shading planes at the start of a run, and its change per column."""
    at = planes[f, which] + planes[f, which + 1] * run[1] + planes[f, which + 2] * run[0]
    return np.float32(at), np.float32(planes[f, which + 1])


@jit_inlined
def shade_smooth_run(
    color: Int, plane: tuple[Float, Float], start: Int, count: Int, inverse_depth: F32, colors: U32
) -> None:
    """Shade a run in one colour of varying brightness; plane: shade over z, per column."""
    first, step = plane
    for i in range(np.int32(count)):
        at = np.uint64(start) + np.uint64(i)
        shade = (first + step * np.float32(i)) / inverse_depth[at]
        shade = min(max(shade, np.float32(0.0)), np.float32(256.0))
        colors[at] = dimmed_color(color, np.int32(shade))


@jit_inlined
def dim_texels(
    plane: tuple[Float, Float], start: Int, count: Int, inverse_depth: F32, colors: U32
) -> None:
    """Dim shaded texels of a run by a varying brightness."""
    first, step = plane
    for i in range(np.int32(count)):
        at = np.uint64(start) + np.uint64(i)
        shade = (first + step * np.float32(i)) / inverse_depth[at]
        shade = min(max(shade, np.float32(0.0)), np.float32(256.0))
        colors[at] = dimmed_color(colors[at], np.int32(shade))


@jit_inlined
def shading_mip_level(
    looks: LookArrays,
    texture: Int,
    planes: F64,
    depth: tuple[Float, Float],
    f: Int,
    run: Run,
    z: Float,
) -> Int:
    """Return the mip level whose texels are about as large as the pixel at a run's start.

    depth: changes of 1/z per column and row. z: metres there.
    """
    row, x, _ = run
    wide, high = float(1 << looks.log2_width[texture]), float(1 << looks.log2_height[texture])
    u = (planes[f, 3] + planes[f, 4] * x + planes[f, 5] * row) * z
    v = (planes[f, 6] + planes[f, 7] * x + planes[f, 8] * row) * z
    across = max(abs(planes[f, 4] - u * depth[0]) * wide, abs(planes[f, 7] - v * depth[0]) * high)
    down = max(abs(planes[f, 5] - u * depth[1]) * wide, abs(planes[f, 8] - v * depth[1]) * high)
    footprint, level = max(across, down) * z, 0
    while footprint > _SHARPNESS and level + 1 < looks.mip_count[texture]:
        footprint *= 0.5
        level += 1
    return level


@jit_inlined
def write_texels(
    texels: U32,
    size: tuple[Int, Int],
    planes: tuple[Float, Float, Float, Float],
    piece: tuple[Int, Int, Int],
    inverse_depth: F32,
    colors: U32,
) -> None:
    """Write unshaded texels of a run. size: log2 of columns and rows of the level.

    planes: u over z and per column, v over z and per column. piece: first texel of the level,
    first pixel, number of pixels.
    """
    first, start, count = piece
    u, u_step, v, v_step = planes
    columns, rows = np.float32(1 << size[0]), np.float32(1 << size[1])
    column_mask, row_mask = np.int32((1 << size[0]) - 1), np.int32((1 << size[1]) - 1)
    for i in range(np.int32(count)):
        at = np.uint64(start) + np.uint64(i)
        z = np.float32(1.0) / inverse_depth[at]
        column = np.int32((u + u_step * np.float32(i)) * z * columns) & column_mask
        row = np.int32((v + v_step * np.float32(i)) * z * rows) & row_mask
        colors[at] = texels[np.uint64(first) + np.uint64((row << size[0]) + column)]


@jit_inlined
def shade_textured_run(
    looks: LookArrays,
    texture: Int,
    shades: ShadeArrays,
    f: Int,
    scratch: ScratchArrays,
    t: Int,
    run: Run,
) -> None:
    """Shade a textured run in pieces, each from the mip level that fits its middle."""
    row, left, total = run
    inverse_depth, colors = scratch.buffer.inverse_depth, scratch.colors
    depth = (scratch.triangles.planes[t, 1], scratch.triangles.planes[t, 2])
    begin = row * scratch.buffer.width + left
    for offset in range(0, total, _CHUNK_PX):
        count = min(_CHUNK_PX, total - offset)
        middle = offset + (count >> 1)
        z = 1.0 / float(inverse_depth[begin + middle])
        here = (row, left + middle, 1)
        level = shading_mip_level(looks, texture, shades.planes, depth, f, here, z)
        wide = max(0, looks.log2_width[texture] - level)
        high = max(0, looks.log2_height[texture] - level)
        u, u_step = shading_plane_along(shades.planes, f, 3, (row, left + offset, count))
        v, v_step = shading_plane_along(shades.planes, f, 6, (row, left + offset, count))
        piece = (looks.mip_start[texture, level], begin + offset, count)
        planes = (u, u_step, v, v_step)
        write_texels(looks.texels, (wide, high), planes, piece, inverse_depth, colors)
    if shades.state[f] == _TEXTURED:
        shade = shades.shade[f]
        for i in range(total):
            at = np.uint64(begin) + np.uint64(i)
            colors[at] = dimmed_color(colors[at], shade)
    else:
        dim_texels(
            shading_plane_along(shades.planes, f, 0, run), begin, total, inverse_depth, colors
        )


@jit_compiled
def shade_pixels(
    geometry: GeometryArrays, looks: LookArrays, view: ViewArrays, scratch: ScratchArrays
) -> None:
    """Shade every pixel, run by run; faces are prepared when they first show."""
    owner, inverse_depth, width = (
        scratch.buffer.triangle,
        scratch.buffer.inverse_depth,
        scratch.buffer.width,
    )
    colors, triangle_face, shades = scratch.colors, scratch.triangles.face, scratch.shades
    state, brightness, planes = shades.state, shades.shade, shades.planes
    material_of, bgr, background = geometry.face_material, looks.bgr, looks.background
    for y in range(view.height):
        start = end = y * width
        while start < (y + 1) * width:
            t = owner[start]
            end = start + 1
            while end < (y + 1) * width and owner[np.uint64(end)] == t:
                end += 1
            run = (y, start - y * width, end - start)
            if t < 0:
                shade_background(background, view, run, start, colors)
                start = end
                continue
            f = triangle_face[t]
            if state[f] == 0:
                prepare_face(geometry, looks, view, scratch.camera, shades, f)
            material = material_of[f]
            if state[f] == _PLAIN:
                color = dimmed_color(bgr[material], brightness[f])
                shade_plain_run(color, start, end - start, colors)
            elif state[f] == _SMOOTH:
                plane = shading_plane_along(planes, f, 0, run)
                shade_smooth_run(bgr[material], plane, start, end - start, inverse_depth, colors)
            else:
                shade_textured_run(looks, looks.texture[material], shades, f, scratch, t, run)
            start = end


@jit_compiled
def write_image(colors: U32, image: U8) -> None:
    """Write shaded packed colours as blue, green, red; image: flat."""
    for i in range(colors.shape[0]):
        color = colors[i]
        at = np.uint64(3 * i)
        image[at] = np.uint8(color & 0xFF)
        image[at + np.uint64(1)] = np.uint8((color >> 8) & 0xFF)
        image[at + np.uint64(2)] = np.uint8((color >> 16) & 0xFF)


@jit_compiled
def write_depth(inverse_depth: F32, depth: F32) -> None:
    """Write the depth of shaded pixels, flat; infinite where 1/z is 0 (nothing)."""
    for i in range(depth.shape[0]):
        depth[i] = np.float32(1.0) / inverse_depth[i]


@jit_compiled
def write_ids(owner: I32, face: I32, face_id: U8, ids: U8) -> None:
    """Write object ids of shaded pixels; flat. face: of each triangle, face_id: of each face."""
    for i in range(ids.shape[0]):
        t = owner[i]
        ids[i] = face_id[np.uint64(face[np.uint64(t)])] if t >= 0 else np.uint8(0)


@jit_compiled
def clear_shading(inverse_depth: F32, owner: I32, state: U8) -> None:
    """Clear the last frame before shading."""
    for i in range(owner.shape[0]):
        inverse_depth[i] = np.float32(0.0)
        owner[i] = np.int32(-1)
    for f in range(state.shape[0]):
        state[f] = np.uint8(0)
