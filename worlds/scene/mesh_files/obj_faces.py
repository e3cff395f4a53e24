"""Reads the faces of an .obj file for what trimesh takes otherwise than the format means it."""

import re
from pathlib import Path

import numpy as np

from worlds.files.limits import MAX_MESH_FACES
from worlds.scene.mesh_files.mesh_polygons import Polygons, check_polygons, numbers
from worlds.scene.mesh_files.mesh_support import UnsupportedMeshError

_RELATIVE_FACE = re.compile(rb"^f[ \t][^\n#]*-", re.MULTILINE)
_POLYGON = re.compile(rb"^f((?:[ \t]+[^\s#]+){4,})", re.MULTILINE)
_POINT = re.compile(rb"^v[ \t]+(\S+[ \t]+\S+[ \t]+\S+)", re.MULTILINE)
_VERTEX = re.compile(rb"^v ", re.MULTILINE)
_CORNER = (b"v", b"vt", b"vn")
"""What the numbers of a face's corner count, in their order."""


def obj_with_absolute_faces(path: Path) -> bytes:
    """Return an .obj file's text in which every face counts from the first vertex.

    A negative number of a face counts back from the vertices before the face; trimesh counts it
    from the end of the file. Raises UnsupportedMeshError for one that counts back too far and for
    a concave face; ValueError and IndexError for a damaged file.
    """
    text = path.read_bytes().replace(b"\r\n", b"\n").replace(b"\\\n", b"")
    if _RELATIVE_FACE.search(text):
        text = _absolute(text)
    _check_faces(text)
    return text


def _absolute(text: bytes) -> bytes:
    counts = dict.fromkeys(_CORNER, 0)
    lines = text.split(b"\n")
    for number, line in enumerate(lines):
        kind = line.partition(b" ")[0]
        if kind in counts:
            counts[kind] += 1
        elif line[:2] in (b"f ", b"f\t") and b"-" in line:
            corners = line[1:].partition(b"#")[0].split()
            lines[number] = b"f " + b" ".join(_absolute_corner(one, counts) for one in corners)
    return b"\n".join(lines)


def _absolute_corner(corner: bytes, counts: dict[bytes, int]) -> bytes:
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


def _check_faces(text: bytes) -> None:
    """Raise UnsupportedMeshError where a face is concave."""
    polygons = _POLYGON.findall(text)
    # More are refused when they are read.
    if not polygons or len(polygons) > MAX_MESH_FACES:
        return
    lists = [[int(one.partition(b"/")[0]) for one in corners.split()] for corners in polygons]
    sizes = np.array([len(each) for each in lists], np.int64)
    corners = np.array([number - 1 for each in lists for number in each], np.int64)
    points = numbers(b" ".join(_POINT.findall(text)), np.float64).reshape(-1, 3)
    if len(points) != sum(1 for _ in _VERTEX.finditer(text)):
        raise ValueError("a vertex has fewer than three coordinates")
    check_polygons(Polygons(points, corners, sizes))
