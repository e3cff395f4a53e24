"""Checks the sizes that a mesh file states, before anything is allocated, and what it needs.

A file of a few bytes may state a million instances of a mesh, a thousand million vertices, or
entities that expand without end. Sizes, counts and depths are in foundation.files.limits.
"""

import base64
import contextlib
import re
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from wil_campaign.foundation.files.images import ImageError, check_image_size, image_size
from wil_campaign.foundation.files.limits import (
    MAX_MESH_BYTES,
    MAX_MESH_DEPTH,
    MAX_MESH_FACES,
    MAX_MESH_NODES,
    MAX_MESH_VALUES,
)
from wil_campaign.foundation.files.paths import is_file
from wil_campaign.plugins.meshes.mesh_support import check_gltf_support

_STRIP_MODES = frozenset({5, 6})
"""TRIANGLE_STRIP and TRIANGLE_FAN: a face for each index, glTF 2.0, 3.7.2.1."""
_PLY_ELEMENT = re.compile(rb"^element\s+\S+\s+(\d{1,18})\s*$", re.MULTILINE)
_PLY_HEAD_BYTES = 65536
_DAMAGE = (
    ValueError,
    TypeError,
    ArithmeticError,
    LookupError,
    AttributeError,
    RecursionError,
)
_COLLADA_FACES = ("triangles", "polylist", "polygons", "tristrips", "trifans")

Graph = Mapping[str, tuple[int, tuple[str, ...]]]
"""By node: the faces of its own meshes, and the nodes beneath it."""


class MeshLimitError(Exception):
    """A mesh file beyond a limit; says which."""


def check_mesh_file_size(path: Path) -> None:
    """Raise MeshLimitError for a mesh file that is too large to be opened."""
    if path.stat().st_size > MAX_MESH_BYTES:
        raise MeshLimitError(f"it is larger than {MAX_MESH_BYTES} bytes")


def check_gltf(path: Path, document: Mapping[str, Any]) -> None:
    """Raise MeshLimitError for a glTF file that is too large, or would become so.

    Raises UnsupportedMeshError for extensions by which it would be misread.
    """
    checks: tuple[Callable[[Mapping[str, Any]], None], ...] = (
        partial(_check_buffers, path),
        _check_counts,
        _check_scene,
        check_gltf_support,
    )
    for check in checks:
        # What a check cannot read is damaged, and the reader refuses it.
        with contextlib.suppress(*_DAMAGE):
            check(document)


def _check_scene(document: Mapping[str, Any]) -> None:
    _check_graph(_gltf_graph(document), [str(index) for index in _gltf_roots(document)])


def _check_buffers(path: Path, document: Mapping[str, Any]) -> None:
    """Check files beside the glTF file; embedded buffers are limited by its own size."""
    for part in (*document.get("buffers", ()), *document.get("images", ())):
        uri = part.get("uri", "data:")
        if not uri.startswith("data:"):
            beside = path.parent / uri
            if is_file(beside) and beside.stat().st_size > MAX_MESH_BYTES:
                raise MeshLimitError(f"'{uri}' is larger than {MAX_MESH_BYTES} bytes")
    for image in document.get("images", ()):
        _check_image(path, image.get("uri", "data:"))


def _check_image(path: Path, uri: str) -> None:
    """Check the size that an image states; one in a buffer is checked when it is used."""
    if uri.startswith("data:"):
        data = base64.b64decode(uri.partition(",")[2])
    elif is_file(path.parent / uri):
        data = (path.parent / uri).read_bytes()
    else:
        return
    if (size := image_size(data)) is not None:
        try:
            check_image_size(*size)
        except ImageError as error:
            raise MeshLimitError(f"an image in it cannot be decoded: {error}") from error


def _check_counts(document: Mapping[str, Any]) -> None:
    values = sum(int(accessor["count"]) for accessor in document.get("accessors", ()))
    if values > MAX_MESH_VALUES:
        raise MeshLimitError(f"it has {values} values; at most {MAX_MESH_VALUES} are read")


def _gltf_graph(document: Mapping[str, Any]) -> Graph:
    meshes = [
        _gltf_faces(mesh, document.get("accessors", ())) for mesh in document.get("meshes", ())
    ]
    return {
        str(index): (
            meshes[node["mesh"]] if "mesh" in node else 0,
            tuple(map(str, node.get("children", ()))),
        )
        for index, node in enumerate(document.get("nodes", ()))
    }


def _gltf_roots(document: Mapping[str, Any]) -> Iterable[int]:
    scenes = document.get("scenes", ())
    found = {root for scene in scenes for root in scene.get("nodes", ())}
    return found or range(len(document.get("nodes", ())))


def _gltf_faces(mesh: Mapping[str, Any], accessors: Any) -> int:
    faces = 0
    for part in mesh["primitives"]:
        by = part["indices"] if "indices" in part else part["attributes"]["POSITION"]
        count = int(accessors[by]["count"])
        faces += count if part.get("mode", 4) in _STRIP_MODES else count // 3
    return faces


def _check_graph(graph: Graph, roots: Iterable[str]) -> None:
    """Walk a scene graph with all its instances; stop as soon as one limit is exceeded."""
    waiting = [(root, 1) for root in roots]
    nodes = faces = 0
    while waiting:
        name, depth = waiting.pop()
        own, beneath = graph.get(name, (0, ()))
        nodes, faces = nodes + 1, faces + own
        if faces > MAX_MESH_FACES:
            raise MeshLimitError(f"it has more than {MAX_MESH_FACES} faces; reduce it to fewer")
        if nodes > MAX_MESH_NODES or len(waiting) + len(beneath) > MAX_MESH_NODES:
            raise MeshLimitError(f"it has more than {MAX_MESH_NODES} nodes with their instances")
        if depth > MAX_MESH_DEPTH:
            raise MeshLimitError(f"its nodes are nested more than {MAX_MESH_DEPTH} deep")
        waiting += [(one, depth + 1) for one in beneath]


def open_collada(path: Path) -> ET.Element:
    """Return the root of a Collada file.

    Raises MeshLimitError for one that is too large, or would become so; others for damage.
    """
    data = path.read_bytes()
    if b"\0" in data[:64] or b"<!" in data.replace(b"<!--", b"").replace(b"<![CDATA[", b""):
        raise MeshLimitError("it has a document type, or is not UTF-8: entities are not expanded")
    root = ET.fromstring(data)  # noqa: S314 - without a document type nothing is expanded
    if not root.tag.endswith("COLLADA"):
        raise ValueError("not Collada")
    _check_graph(_collada_graph(root), ["scenes"])
    return root


def _collada_graph(root: ET.Element) -> Graph:
    faces: dict[str, int] = {}
    for geometry in root.iterfind(".//{*}geometry"):
        counts = [
            int(part.get("count", "0"))
            for kind in _COLLADA_FACES
            for part in geometry.iterfind(f".//{{*}}{kind}")
        ]
        faces[geometry.get("id", "")] = sum(counts)
    graph: dict[str, tuple[int, tuple[str, ...]]] = {}
    for number, node in enumerate(root.iterfind(".//{*}node")):
        node.set("wil", str(number))
    for node in root.iterfind(".//{*}node"):
        own = sum(faces.get(_ref(element), 0) for element in node.iterfind("{*}instance_geometry"))
        inner = [f"#{element.get('wil')}" for element in node.iterfind("{*}node")]
        beneath = [*inner, *(_ref(element) for element in node.iterfind("{*}instance_node"))]
        for name in (f"#{node.get('wil')}", node.get("id", "")):
            graph[name] = (own, tuple(beneath))
    scenes = root.iterfind(".//{*}visual_scene")
    tops = tuple(f"#{node.get('wil')}" for scene in scenes for node in scene.iterfind("{*}node"))
    graph["scenes"] = (0, tops)
    return graph


def _ref(instance: ET.Element) -> str:
    return instance.get("url", "").removeprefix("#")


def check_ply(path: Path) -> None:
    """Raise MeshLimitError for a .ply file that states too much."""
    with path.open("rb") as stream:
        head = stream.read(_PLY_HEAD_BYTES).partition(b"end_header")[0]
    values = sum(int(count) for count in _PLY_ELEMENT.findall(head))
    if values > MAX_MESH_VALUES:
        raise MeshLimitError(f"it has {values} elements; at most {MAX_MESH_VALUES} are read")
