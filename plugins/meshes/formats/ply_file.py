"""Reads .ply files through trimesh, and holds what was read against what the file states.

Greg Turk, "The PLY Polygon File Format", 1994.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from wil_campaign.plugins.meshes.beside import image_beside
from wil_campaign.plugins.meshes.looks import NO_LOOK, FilePart, LookPicture, SurfaceLook
from wil_campaign.plugins.meshes.mesh_polygons import (
    Integers,
    check_polygons,
    ply_polygons,
    polygon_fans,
)
from wil_campaign.plugins.meshes.mesh_support import UnsupportedMeshError
from wil_campaign.worlds.scene.meshes import FloatArray

_HEAD_BYTES = 65536
_TEXTURE = re.compile(rb"^comment\s+TextureFile[ \t]+(.+?)\s*$", re.MULTILINE | re.IGNORECASE)
_ELEMENT = re.compile(rb"^element\s+(\S+)\s+(\d{1,18})\s*$", re.MULTILINE)
_COLORS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
_PLACES = (("texture_u", "texture_v"), ("u", "v"), ("s", "t"))
_READ = frozenset({"vertex", "face"})
_NO_SURFACE = frozenset({"edge", "vertex", "material", "camera", "obj_info"})


def texture_named(path: Path) -> str:
    """Return the image that a .ply file names; "" for none."""
    with path.open("rb") as stream:
        found = _TEXTURE.search(stream.read(_HEAD_BYTES).partition(b"end_header")[0])
    return found[1].decode("utf-8", "surrogateescape") if found else ""


def read_ply(path: Path) -> list[FilePart]:
    """Return the faces of a .ply file.

    Raises UnsupportedMeshError for what would be left out or misread, and for one that ends early;
    other errors for a damaged file.
    """
    # Half a second that only worlds with such files pay.
    import trimesh  # noqa: PLC0415

    _check_rows(path.read_bytes())
    with path.open("rb") as stream:
        loaded = trimesh.exchange.ply.load_ply(stream, skip_materials=True)
    raw: Mapping[str, Any] = loaded["metadata"]["_ply_raw"]
    polygons = ply_polygons(raw)
    if polygons is None:
        return []
    stated = raw["face"]["length"]
    if len(polygons.sizes) != stated or len(polygons.points) != raw["vertex"]["length"]:
        raise UnsupportedMeshError(
            f"it is cut off: {len(polygons.sizes)} of {stated} faces and {len(polygons.points)} of "
            f"{raw['vertex']['length']} vertices are there"
        )
    if len(polygons.sizes) and polygons.sizes.min() < len("xyz"):
        raise UnsupportedMeshError(f"a face has {polygons.sizes.min()} corners: it is damaged")
    check_polygons(polygons)
    triangles = polygon_fans(polygons.sizes)
    owner = np.repeat(np.arange(len(polygons.sizes)), polygons.sizes - 2)
    at = polygons.corners[triangles]
    by_vertex, by_face = _colors(raw["vertex"]), _colors(raw["face"])
    colors = by_vertex if by_face is None else by_face[owner]
    look, is_by_face = _look(path), by_face is not None
    if look.picture is None:
        faces = at.astype(np.int32)
        return [FilePart(polygons.points, faces, look, colors=colors, is_by_face=is_by_face)]
    return [
        FilePart(
            vertices=polygons.points[at].reshape(-1, 3),
            faces=np.arange(at.size, dtype=np.int32).reshape(-1, 3),
            look=look,
            uv=_places(raw, triangles, at.reshape(-1)),
            colors=colors if colors is None or is_by_face else colors[at].reshape(-1, 3),
            is_by_face=is_by_face,
        )
    ]


def _check_rows(data: bytes) -> None:
    """Refuse a text file that has fewer lines than it states, and elements that have surfaces.

    The reader takes the lines that are there, one for each element.
    """
    head, _, body = data.partition(b"end_header")
    elements = [(name.decode("ascii", "replace"), int(n)) for name, n in _ELEMENT.findall(head)]
    names = [name for name, _ in elements]
    for name, count in elements:
        if names.count(name) > 1:
            raise UnsupportedMeshError(
                f"it has elements '{name[:40]}' twice, and only one would be read; export it anew"
            )
        if count and name not in _READ | _NO_SURFACE:
            raise UnsupportedMeshError(
                f"it has elements '{name[:40]}', which are not supported; export it with faces"
            )
    if b"ascii" not in head[:80]:
        return
    rows = body.split(b"\n", 1)[-1].splitlines()
    stated = sum(count for _, count in elements)
    there = sum(1 for row in rows[:stated] if row.strip())
    if there < stated:
        raise UnsupportedMeshError(f"it is cut off: {there} of {stated} lines of data are there")


def _look(path: Path) -> SurfaceLook:
    name = texture_named(path)
    if not name:
        return NO_LOOK
    by = "it"
    return SurfaceLook(name, (1.0, 1.0, 1.0), LookPicture(image_beside(path.parent, name, by=by)))


def _column(element: Mapping[str, Any], name: str) -> FloatArray:
    return np.asarray(element["data"][name]).reshape(-1).astype(np.float64)


def _colors(element: Mapping[str, Any]) -> FloatArray | None:
    """Return the colours of an element, (n, 3), 0 to 1; None without."""
    for names in _COLORS:
        if all(name in element["properties"] for name in names):
            kind = np.dtype(element["properties"][names[0]])
            most = float(np.iinfo(kind).max) if kind.kind in "iu" else 1.0
            return np.stack([_column(element, name) for name in names], axis=1) / most
    return None


def _places(raw: Mapping[str, Any], triangles: Integers, at: Integers) -> FloatArray | None:
    """Return the texture coordinates of the triangles' corners: of faces, or of vertices."""
    if "texcoord" in raw["face"]["properties"]:
        found = raw["face"]["data"]["texcoord"]
        if isinstance(found, np.ndarray) and found.dtype.names:
            found = found["f1"]
        flat = np.concatenate([np.asarray(one, np.float64).reshape(-1) for one in found])
        return flat.reshape(-1, 2)[triangles].reshape(-1, 2)
    for names in _PLACES:
        if all(name in raw["vertex"]["properties"] for name in names):
            return np.stack([_column(raw["vertex"], name) for name in names], axis=1)[at]
    return None
