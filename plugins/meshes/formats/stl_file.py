"""Reads .stl files through trimesh, and holds what was read against what the file states."""

import re
from pathlib import Path

import numpy as np

from wil_campaign.plugins.meshes.looks import FilePart
from wil_campaign.plugins.meshes.mesh_support import UnsupportedMeshError

_WORDS = {
    word: re.compile(rb"^[ \t]*%s\b" % word, re.MULTILINE | re.IGNORECASE)
    for word in (b"facet", b"endfacet", b"vertex", b"solid", b"endsolid")
}
_HEAD_BYTES, _FACET_BYTES = 84, 50


def read_stl(path: Path) -> list[FilePart]:
    """Return the facets of an .stl file.

    Raises UnsupportedMeshError for one that ends early, and where facets are left out; other errors
    for a damaged file.
    """
    # Half a second that only worlds with such files pay.
    import trimesh  # noqa: PLC0415

    stated = _facets(path.read_bytes())
    scene = trimesh.load_scene(str(path), process=False)
    parts = [
        FilePart(np.asarray(part.vertices, np.float64), np.asarray(part.faces, np.int32))
        for part in scene.dump()
        if isinstance(part, trimesh.Trimesh)
    ]
    read = sum(len(part.faces) for part in parts)
    if parts and read != stated:
        raise UnsupportedMeshError(f"it has {stated} facets, of which {read} can be read")
    return parts


def _facets(data: bytes) -> int:
    """Return the number of facets that a file has. Raises UnsupportedMeshError when it is cut."""
    stated = int.from_bytes(data[_HEAD_BYTES - 4 : _HEAD_BYTES], "little")
    if len(data) == _HEAD_BYTES + _FACET_BYTES * stated or data[:5].lower() != b"solid":
        return stated
    data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    count = {word: len(pattern.findall(data)) for word, pattern in _WORDS.items()}
    if (
        count[b"facet"] != count[b"endfacet"]
        or count[b"vertex"] != 3 * count[b"facet"]
        or count[b"solid"] != count[b"endsolid"]
    ):
        raise UnsupportedMeshError(
            f"it is cut off: {count[b'endfacet']} of {count[b'facet']} facets end, and "
            f"{count[b'endsolid']} of {count[b'solid']} solids"
        )
    return count[b"facet"]
