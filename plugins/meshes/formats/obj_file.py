"""Reads .obj files: every face of every material, or a reason why not.

Wavefront, "Object Files (.obj)", appendix B1. Points and lines have no surface, and are left out.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wil_campaign.foundation.files.lfs import is_lfs_pointer
from wil_campaign.foundation.files.limits import MAX_MESH_FACES, MAX_MESH_VALUES
from wil_campaign.plugins.meshes.formats.obj_materials import ObjMaterials, libraries_of
from wil_campaign.plugins.meshes.looks import FilePart
from wil_campaign.plugins.meshes.mesh_polygons import (
    Integers,
    MeshPolygons,
    check_polygons,
    numbers_in_text,
    polygon_fans,
)
from wil_campaign.plugins.meshes.mesh_support import UnsupportedMeshError
from wil_campaign.worlds.scene.meshes import FloatArray

_MARGIN = re.compile(rb"^ +", re.MULTILINE)
_REMARK = re.compile(rb"^((?:v|vt|vn|f) [^#\n]*)#.*$", re.MULTILINE)
_UNREAD = re.compile(rb"^(surf|bzp|bsp|fo|call|csh)\b", re.MULTILINE)
"""Free-form surfaces, an old word for faces, and other files."""
_WORDS = (
    b"v vt vn vp f l p g o s mg usemtl mtllib usemap maplib bevel c_interp d_interp lod shadow_obj "
    b"trace_obj ctech stech cstype deg bmat step curv curv2 parm trim hole scrv sp end con res cdc "
    b"cdp"
).split()
"""Statements that are read, and those that make no surface without `surf`."""
_UNKNOWN = re.compile(rb"^(?!(?:%s)(?: |$)|#)[^\n]+" % b"|".join(_WORDS), re.MULTILINE)
_COMMENT = re.compile(rb"^[ \t]*#.*$", re.MULTILINE)
_SWALLOWED = re.compile(rb"\\\n[ \t]*(?:v|vt|vn|f|g|o|s|usemtl|mtllib)[ \t]")
"""A line that a backslash before it makes a part of the one above."""
_RELATIVE_FACE = re.compile(rb"^f [^\n]*-", re.MULTILINE)
_FACE = re.compile(rb"^f(?: (.*))?$", re.MULTILINE)
_USED = re.compile(rb"^usemtl(?: +(.*?))? *$", re.MULTILINE)
_BEHIND_SLASH = re.compile(rb"/[^ \n]*")
_BEFORE_SLASH = re.compile(rb"[^ \n/]+/([^ \n/]*)[^ \n]*")
_CORNER = (b"v", b"vt", b"vn")
"""What the numbers of a face's corner count, in their order."""


@dataclass(frozen=True, slots=True, eq=False)
class _Values:
    """What faces refer to. points: (n, 3), colors: (n, 3) or None, places: (k, 2) of textures."""

    points: FloatArray
    colors: FloatArray | None
    places: FloatArray


def read_obj(path: Path) -> list[FilePart]:
    """Return the parts of an .obj file, one for each material.

    Raises UnsupportedMeshError for what would be left out, misread or looks otherwise; ValueError
    for a damaged file.
    """
    text = _plain(path.read_bytes())
    found = _UNREAD.search(text)
    if found is not None:
        raise UnsupportedMeshError(
            f"it has '{found[1].decode()}' (free-form surfaces, other files), which is not "
            "supported; export the mesh with triangulated faces"
        )
    _check_words(text)
    if _RELATIVE_FACE.search(text):
        text = _absolute(text)
    values = _values(text)
    materials = ObjMaterials.beside(path, text)
    return [
        _part(name, lines, values, materials) for name, lines in _faces_by_material(text).items()
    ]


def libraries_named(path: Path) -> list[Path]:
    """Return the libraries of materials that an .obj file names. Raises UnsupportedMeshError."""
    return list(libraries_of(path, _plain(path.read_bytes())))


def _plain(text: bytes) -> bytes:
    """Return the text with one statement on a line, single words and no remarks behind numbers."""
    if text[:2] in (b"\xfe\xff", b"\xff\xfe"):
        text = text.decode("utf-16").encode()
    text = text.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    text = text.replace(b"\t", b" ").replace(b"\v", b" ").replace(b"\f", b" ")
    if b"\\\n" in text:
        # A remark may end in a backslash, as paths do, and does not go on.
        text = _REMARK.sub(rb"\1", _COMMENT.sub(b"", text))
        if _SWALLOWED.search(text):
            raise UnsupportedMeshError(
                "a line that ends in a backslash goes on in a statement of its own"
            )
        text = text.replace(b"\\\n", b" ")
    text = _MARGIN.sub(b"", text)
    return _REMARK.sub(rb"\1", text) if b"#" in text else text


def _check_words(text: bytes) -> None:
    """Refuse statements that nobody knows: they may be faces behind a stray byte or in capitals."""
    found = _UNKNOWN.search(text)
    if found is not None and is_lfs_pointer(text):
        raise ValueError("a pointer of Git LFS")
    if found is not None:
        word = found[0].split(b" ")[0][:20].decode("utf-8", "backslashreplace")
        raise UnsupportedMeshError(
            f"it has the statement {word!r}, which is unknown; export the mesh anew"
        )


def _absolute(text: bytes) -> bytes:
    """Return the text in which every face counts from the first vertex.

    A negative number counts back from the vertices before the face.
    """
    counts = dict.fromkeys(_CORNER, 0)
    lines = text.split(b"\n")
    for number, line in enumerate(lines):
        kind = line.partition(b" ")[0]
        if kind in counts:
            counts[kind] += 1
        elif kind == b"f" and b"-" in line:
            corners = line[1:].split()
            lines[number] = b"f " + b" ".join(
                _absolute_corner(corner, counts) for corner in corners
            )
    return b"\n".join(lines)


def _absolute_corner(corner: bytes, counts: Mapping[bytes, int]) -> bytes:
    parts = corner.split(b"/")
    pairs = zip(parts, _CORNER, strict=False)
    return b"/".join(_absolute_number(part, counts[kind]) for part, kind in pairs)


def _absolute_number(written: bytes, count: int) -> bytes:
    if not written.startswith(b"-"):
        return written
    number = count + 1 + int(written)
    if number < 1:
        raise UnsupportedMeshError(
            f"a face counts {-int(written)} vertices back where only {count} come before it"
        )
    return b"%d" % number


def _values(text: bytes) -> _Values:
    table = _table(text, b"v")
    if table.shape[1] not in (0, 3, 4, 6, 7):
        raise ValueError("a vertex has a number of values that has no meaning")
    colors = table[:, 3:6] if table.shape[1] > len("xyzw") else None
    return _Values(table[:, :3], colors, _table(text, b"vt")[:, :2])


def _table(text: bytes, keyword: bytes) -> FloatArray:
    """Return the numbers of all statements of a keyword, (n, numbers of the shortest)."""
    rows = re.findall(rb"^%s (.*)$" % keyword, text, re.MULTILINE)
    if len(rows) > MAX_MESH_VALUES:
        raise UnsupportedMeshError(f"it has {len(rows)} values; at most {MAX_MESH_VALUES} are read")
    sizes = {len(row.split()) for row in rows}
    if keyword == b"v" and max(sizes, default=0) > len("xyzw") and len(sizes) > 1:
        raise UnsupportedMeshError("some of its vertices have colours, and others have none")
    least = min(sizes, default=0)
    if keyword == b"v" and rows and least < len("xyz"):
        raise ValueError("a vertex has fewer than three coordinates")
    if len(sizes) > 1:
        rows = [b" ".join(row.split()[:least]) for row in rows]
    table = numbers_in_text(b" ".join(rows), np.float64).reshape(len(rows), least)
    missing = max(0, 2 - least)
    return np.pad(table, ((0, 0), (0, missing))) if missing else table


def _faces_by_material(text: bytes) -> dict[str, list[bytes]]:
    found: dict[str, list[bytes]] = {}
    first, *others = _USED.split(text)
    names = ["", *((name or b"").decode("utf-8", "surrogateescape") for name in others[::2])]
    for name, piece in zip(names, [first, *others[1::2]], strict=True):
        lines = _FACE.findall(piece)
        if lines:
            found.setdefault(name, []).extend(lines)
    if sum(map(len, found.values())) > MAX_MESH_FACES:
        raise UnsupportedMeshError(f"it has more than {MAX_MESH_FACES} faces; reduce it to fewer")
    return found


def _part(name: str, lines: list[bytes], values: _Values, materials: ObjMaterials) -> FilePart:
    sizes = np.array([len(line.split()) for line in lines], np.int64)
    slashes = np.array([line.count(b"/") for line in lines], np.int64)
    if sizes.min() < len("xyz"):
        raise UnsupportedMeshError(f"a face has {sizes.min()} corners: it is cut off or damaged")
    if (slashes % sizes).any():
        raise UnsupportedMeshError(
            "a face has corners of different forms: it is cut off or damaged"
        )
    text = b"\n".join(lines)
    corners = _indices(_BEHIND_SLASH.sub(b"", text), len(values.points), "vertex")
    check_polygons(MeshPolygons(values.points, corners, sizes))
    triangles = polygon_fans(sizes)
    look = materials.look(name)
    uv = None
    if look.picture is not None and (slashes > 0).all() and b"//" not in text:
        placed = _indices(_BEFORE_SLASH.sub(rb"\1", text), len(values.places), "texture place")
        uv = values.places[placed][triangles].reshape(-1, 2)
    at = corners[triangles]
    if uv is None and len(values.points) <= at.size:
        return FilePart(values.points, at.astype(np.int32), look, colors=values.colors)
    return FilePart(
        vertices=values.points[at].reshape(-1, 3),
        faces=np.arange(at.size, dtype=np.int32).reshape(-1, 3),
        look=look,
        uv=uv,
        colors=None if values.colors is None else values.colors[at].reshape(-1, 3),
    )


def _indices(text: bytes, count: int, what: str) -> Integers:
    """Return numbers that count from 1 as indices. Raises UnsupportedMeshError for others."""
    found = numbers_in_text(text, np.int64) - 1
    outside = found[(found < 0) | (found >= count)]
    if len(outside):
        raise UnsupportedMeshError(
            f"a face refers to {what} {outside[0] + 1}, which is not one of its {count}"
        )
    return found
