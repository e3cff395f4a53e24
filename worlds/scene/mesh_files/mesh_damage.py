"""Diagnoses a mesh file that cannot be read, by the rules of its format."""

import json
import struct
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from xml.etree import ElementTree as ET

from wil_campaign.worlds.files.lfs import LFS_POINTER, is_lfs_pointer

_GLB_HEAD = struct.Struct("<4sII")
_GLB_CHUNK = struct.Struct("<I4s")
_STL_HEAD_BYTES, _STL_FACET_BYTES = 84, 50


def damage(path: Path) -> str:
    """Return how a mesh file of a known suffix is damaged or malformed; "" when sound.

    GLB: glTF 2.0, chapter 4.4 "Binary glTF Layout". STL: 80 bytes, a count, 50 bytes a facet.
    """
    data = path.read_bytes()
    if not data:
        return "it is empty"
    if is_lfs_pointer(data):
        return LFS_POINTER
    diagnose = _DIAGNOSES.get(path.suffix.lower())
    return "" if diagnose is None else diagnose(data)


def _glb(data: bytes) -> str:
    """Return how a GLB mesh file is damaged; "" when sound."""
    if data[:4] != b"glTF":
        return "it is not a GLB file: it does not begin with 'glTF'"
    if len(data) < _GLB_HEAD.size + _GLB_CHUNK.size:
        return f"it is cut off after {len(data)} bytes"
    _, version, length = _GLB_HEAD.unpack_from(data)
    if version != 2:
        return f"it is of glTF version {version}; only version 2 is supported"
    if len(data) < length:
        return f"it is cut off: {len(data)} of {length} bytes are there"
    count, kind = _GLB_CHUNK.unpack_from(data, _GLB_HEAD.size)
    if kind != b"JSON":
        return "its first chunk is not JSON"
    begin = _GLB_HEAD.size + _GLB_CHUNK.size
    return _json(data[begin : begin + count], "its description")


def _json(data: bytes, what: str) -> str:
    """Return how a glTF mesh file's JSON is damaged; "" when sound."""
    try:
        document = json.loads(data)
    except json.JSONDecodeError as error:
        return f"{what} is not JSON (line {error.lineno}, column {error.colno})"
    except (UnicodeDecodeError, RecursionError):
        return f"{what} is not JSON"
    if not isinstance(document, dict) or not isinstance(document.get("asset"), dict):
        return f"{what} is JSON but not glTF"
    version = str(document["asset"].get("version", "unknown"))
    if not version.startswith("2."):
        return f"it is of glTF version {version[:20]}; only version 2 is supported"
    return ""


def _xml(data: bytes) -> str:
    """Return how a Collada mesh file's XML is damaged; "" when sound."""
    try:
        root = ET.fromstring(data)  # noqa: S314 - a file that the user names, on the user's machine
    except ET.ParseError as error:
        line, column = error.position
        return f"it is not XML (line {line}, column {column + 1})"
    return "" if root.tag.endswith("COLLADA") else "it is XML but not Collada"


def _stl(data: bytes) -> str:
    """Return how a binary STL mesh file is damaged; "" when sound."""
    if data[:5].lower() == b"solid":
        return "its text is not STL: facets need three vertices"
    if len(data) < _STL_HEAD_BYTES:
        return f"it is cut off after {len(data)} bytes"
    (count,) = struct.unpack_from("<I", data, _STL_HEAD_BYTES - 4)
    there = (len(data) - _STL_HEAD_BYTES) // _STL_FACET_BYTES
    if there < count:
        return f"it is cut off: {there} of {count} facets are there"
    return ""


_DIAGNOSES: Mapping[str, Callable[[bytes], str]] = {
    ".glb": _glb,
    ".gltf": partial(_json, what="it"),
    ".dae": _xml,
    ".stl": _stl,
}
