"""Finds the files that a mesh file names: beside it, or in a folder near above it."""

import posixpath
import re
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

from wil_campaign.foundation.files.limits import MAX_MESH_BYTES, MAX_MESH_PARENTS
from wil_campaign.foundation.files.paths import is_file
from wil_campaign.plugins.meshes.mesh_support import UnsupportedMeshError

_ABSOLUTE = re.compile(r"(?:/|~|[A-Za-z]:|[A-Za-z][A-Za-z+.-]+:)")
"""A path of one machine, or an address: file:, model:, package:, https:."""
_GAZEBO_TEXTURES = "../materials/textures/"
"""Where Gazebo looks for an image that is not where a model's mesh names it."""
_SHOWN = 80


def file_beside(folder: Path, written: str, *, by: str = "it", is_uri: bool = False) -> Path:
    """Return the file that a mesh file in a folder names. is_uri: whether %20 is a blank.

    Backslashes of Windows are taken as slashes. by: what names it, for messages. Raises
    UnsupportedMeshError for a name that leads far away, a missing file, and one that is too large.
    """
    return _resolved(folder, written, (f"{by} names the file", ""), is_uri=is_uri)


def image_beside(folder: Path, written: str, *, by: str, is_uri: bool = False) -> Path:
    """Return the image that a mesh file names, as `file_beside` does; Gazebo's place counts too."""
    return _resolved(folder, written, (f"{by} names the image", _GAZEBO_TEXTURES), is_uri=is_uri)


def _resolved(folder: Path, written: str, how: tuple[str, str], *, is_uri: bool) -> Path:
    """Return a named file. how: the beginning of messages, and the folder to search as well."""
    opening, other = how
    shown = f"{opening} '{written[:_SHOWN]}'"
    names = list(_readings(written, is_uri=is_uri))
    if any(map(_is_far, names)):
        raise UnsupportedMeshError(
            f"{shown}, which is not beside it or below one of the {MAX_MESH_PARENTS} folders "
            "above; name it by a relative path"
        )
    for path in (
        folder / (before + name) for before in dict.fromkeys(["", other]) for name in names
    ):
        if is_file(path):
            if path.stat().st_size > MAX_MESH_BYTES:
                raise UnsupportedMeshError(f"{shown}, which is larger than {MAX_MESH_BYTES} bytes")
            return path
    raise UnsupportedMeshError(f"{shown}: no such file")


def _readings(written: str, *, is_uri: bool) -> Iterator[str]:
    """Yield what a name may mean, the likeliest first."""
    names = [unquote(written), written] if is_uri else [written]
    for name in dict.fromkeys([*names, *(one.replace("\\", "/") for one in names)]):
        if name and "\0" not in name:
            yield name


def _is_far(name: str) -> bool:
    up = posixpath.normpath(name.replace("\\", "/")).split("/")[: MAX_MESH_PARENTS + 1]
    return bool(_ABSOLUTE.match(name)) or up == [".."] * (MAX_MESH_PARENTS + 1)
