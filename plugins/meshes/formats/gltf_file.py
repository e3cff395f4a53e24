"""Reads .gltf and .glb files: every mesh of every node of their scene, or a reason why not.

Paragraphs are those of the glTF 2.0 specification. Points and lines have no surface, and are left
out; so are animations, whose meshes stand as their nodes do.
"""

import base64
import json
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote_to_bytes

import numpy as np
from numpy.typing import NDArray

from wil_campaign.plugins.meshes.beside import file_beside
from wil_campaign.plugins.meshes.formats.gltf_materials import GltfMaterials
from wil_campaign.plugins.meshes.looks import NO_LOOK, FilePart, SurfaceLook
from wil_campaign.plugins.meshes.mesh_support import (
    SURFACE_MODES,
    UnsupportedMeshError,
    check_gltf_node,
    check_place,
    gltf_name,
)
from wil_campaign.worlds.scene.meshes import FloatArray

_GLB_HEAD = struct.Struct("<4sII")
_GLB_CHUNK = struct.Struct("<I4s")
_TYPES: Mapping[int, type[np.generic]] = {
    5120: np.int8,
    5121: np.uint8,
    5122: np.int16,
    5123: np.uint16,
    5125: np.uint32,
    5126: np.float32,
}
_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_TRIANGLES, _FAN = 4, 6
_NO_ROTATION = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class GltfFile:
    """A glTF file's document, and the binary chunk of a .glb file."""

    path: Path
    document: Mapping[str, Any]
    binary: bytes = b""
    _buffers: dict[int, bytes] = field(default_factory=dict)

    def view(self, index: int) -> bytes:
        """Return the bytes of a buffer view (3.6.1). Raises UnsupportedMeshError when short."""
        view = self.document["bufferViews"][index]
        data = self._buffer(view["buffer"])
        begin = int(view.get("byteOffset", 0))
        end = begin + int(view["byteLength"])
        if not 0 <= begin <= end <= len(data):
            raise UnsupportedMeshError(
                f"its buffer {view['buffer']} is cut off: {len(data)} bytes are there, and data "
                f"lie up to byte {end}"
            )
        return data[begin:end]

    def embedded(self, uri: str) -> bytes | None:
        """Return the bytes in a `data:` address; None for another one."""
        if not uri.startswith("data:"):
            return None
        head, _, body = uri.partition(",")
        return base64.b64decode(body) if head.endswith(";base64") else unquote_to_bytes(body)

    def _buffer(self, index: int) -> bytes:
        if index not in self._buffers:
            buffer = self.document["buffers"][index]
            uri = buffer.get("uri")
            if uri is None:
                data = self.binary if index == 0 else b""
            elif (embedded := self.embedded(uri)) is not None:
                data = embedded
            else:
                data = file_beside(self.path.parent, uri, is_uri=True).read_bytes()
            if len(data) < int(buffer["byteLength"]):
                raise UnsupportedMeshError(
                    f"its buffer {index} is cut off: {len(data)} of {buffer['byteLength']} bytes "
                    "are there"
                )
            self._buffers[index] = data
        return self._buffers[index]

    def values(self, index: int) -> NDArray[Any]:
        """Return an accessor's values (n, columns), unscaled (3.6.2)."""
        accessor = self.document["accessors"][index]
        kind = np.dtype(_TYPES[accessor["componentType"]]).newbyteorder("<")
        shape = int(accessor["count"]), _COLUMNS[accessor["type"]]
        if "bufferView" not in accessor and "sparse" not in accessor:
            raise UnsupportedMeshError(
                f"its accessor {index} has no data, which may be compressed; export the mesh "
                "without compression"
            )
        values = (
            self._plain(accessor, kind, shape)
            if "bufferView" in accessor
            else np.zeros(shape, kind)
        )
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            count = int(sparse["count"])
            where = dict(sparse["indices"])
            at = self._plain(where, np.dtype(_TYPES[where["componentType"]]), (count, 1))
            values = values.copy()
            values[at[:, 0].astype(np.int64)] = self._plain(
                sparse["values"], kind, (count, shape[1])
            )
        return values

    def _plain(
        self, place: Mapping[str, Any], kind: np.dtype[Any], shape: tuple[int, int]
    ) -> NDArray[Any]:
        data = self.view(place["bufferView"])
        row = kind.itemsize * shape[1]
        stride = int(self.document["bufferViews"][place["bufferView"]].get("byteStride", row))
        begin = int(place.get("byteOffset", 0))
        needed = begin + (stride * (shape[0] - 1) + row if shape[0] else 0)
        if begin < 0 or stride < row or needed > len(data):
            raise UnsupportedMeshError(
                f"its data are cut off: a view of {len(data)} bytes has to have {needed}"
            )
        return np.ndarray(shape, kind, data, begin, (stride, kind.itemsize))

    def scaled(self, index: int) -> FloatArray:
        """Return an accessor's values as numbers: normalized integers are of 0 or -1 to 1."""
        accessor, values = self.document["accessors"][index], self.values(index)
        numbers = values.astype(np.float64)
        if accessor.get("normalized") and values.dtype.kind in "iu":
            numbers = np.maximum(numbers / np.iinfo(values.dtype).max, -1.0)
        return numbers


def open_gltf(path: Path) -> GltfFile:
    """Return a glTF file. Raises ValueError or UnsupportedMeshError for a damaged one."""
    data = path.read_bytes()
    if data[:4] != b"glTF":
        return GltfFile(path, _object(data))
    if len(data) < _GLB_HEAD.size + _GLB_CHUNK.size:
        raise ValueError("cut off")
    _, version, length = _GLB_HEAD.unpack_from(data)
    if version != 2 or len(data) < length:
        raise ValueError("not of version 2, or cut off")
    chunks: dict[bytes, bytes] = {}
    at = _GLB_HEAD.size
    while at + _GLB_CHUNK.size <= length:
        count, kind = _GLB_CHUNK.unpack_from(data, at)
        at += _GLB_CHUNK.size
        if at + count > length:
            raise UnsupportedMeshError(
                f"it is cut off: {length - at} of {count} bytes of a chunk are there"
            )
        chunks.setdefault(kind, data[at : at + count])
        at += count
    return GltfFile(path, _object(chunks.get(b"JSON", b"")), chunks.get(b"BIN\0", b""))


def _object(data: bytes) -> Mapping[str, Any]:
    document = json.loads(data)
    if not isinstance(document, dict) or "asset" not in document:
        raise ValueError("not glTF")
    asset = document.get("asset")
    if isinstance(asset, dict) and not str(asset.get("version", "2.")).startswith("2."):
        raise ValueError("not of version 2")
    return document


def read_gltf(gltf: GltfFile) -> list[FilePart]:
    """Return the parts of a glTF file: the surfaces of all nodes of its scene, in their places.

    Raises UnsupportedMeshError for what would be left out or misread, by its node; other errors
    for a damaged file.
    """
    document = gltf.document
    materials = GltfMaterials(gltf)
    surfaces: dict[int, list[FilePart]] = {}
    found = []
    for index, matrix in placed_gltf_nodes(document):
        node = document["nodes"][index]
        check_gltf_node(document, index)
        if "mesh" not in node:
            continue
        if node["mesh"] not in surfaces:
            surfaces[node["mesh"]] = list(_surfaces(gltf, node["mesh"], materials))
        found += [_moved(part, matrix) for part in surfaces[node["mesh"]]]
    return found


def _moved(part: FilePart, matrix: FloatArray) -> FilePart:
    return FilePart(
        vertices=part.vertices @ matrix[:3, :3].T + matrix[:3, 3],
        faces=part.faces if np.linalg.det(matrix[:3, :3]) >= 0.0 else part.faces[:, ::-1],
        look=part.look,
        uv=part.uv,
        v_is_up=False,
        colors=part.colors,
    )


def gltf_scene_roots(document: Mapping[str, Any]) -> list[int]:
    """Return the top nodes of a document's scene (3.5.1).

    Raises UnsupportedMeshError where the file does not say which scene is meant.
    """
    scenes = document.get("scenes", ())
    if not scenes:
        raise UnsupportedMeshError("it has no scene, which lists the parts that are shown")
    if "scene" not in document and len(scenes) > 1:
        raise UnsupportedMeshError(
            f"it has {len(scenes)} scenes and does not say which is shown; export one of them"
        )
    return [int(root) for root in scenes[document.get("scene", 0)].get("nodes", ())]


def placed_gltf_nodes(document: Mapping[str, Any]) -> Iterator[tuple[int, FloatArray]]:
    """Yield each node of a document's scene with its place (4, 4)."""
    nodes = document.get("nodes", ())
    waiting = [(root, np.eye(4)) for root in reversed(gltf_scene_roots(document))]
    while waiting:
        index, above = waiting.pop()
        place = _matrix(nodes[index])
        check_place(place, gltf_name("node", index, nodes[index]))
        here = above @ place
        yield index, here
        waiting += [(int(one), here) for one in reversed(nodes[index].get("children", ()))]


def _matrix(node: Mapping[str, Any]) -> FloatArray:
    """Return a node's matrix (3.5.3): given by columns, or translation, rotation and scale."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = np.array(node.get("rotation", _NO_ROTATION), np.float64)
    length = x * x + y * y + z * z + w * w
    if length <= 0.0:
        raise UnsupportedMeshError("a node has a rotation of 0 0 0 0: it is damaged")
    turn = np.eye(3) + 2.0 / length * np.array(
        [
            [-y * y - z * z, x * y - z * w, x * z + y * w],
            [x * y + z * w, -x * x - z * z, y * z - x * w],
            [x * z - y * w, y * z + x * w, -x * x - y * y],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = turn * np.array(node.get("scale", (1.0, 1.0, 1.0)), np.float64)
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix


def _surfaces(gltf: GltfFile, index: int, materials: GltfMaterials) -> Iterator[FilePart]:
    mesh = gltf.document["meshes"][index]
    for part in mesh["primitives"]:
        if part.get("mode", _TRIANGLES) not in SURFACE_MODES:
            continue
        attributes = part["attributes"]
        if "POSITION" not in attributes:
            raise UnsupportedMeshError(
                f"{gltf_name('mesh', index, mesh)} has a surface without positions"
            )
        look = materials.look(part["material"]) if "material" in part else _WHITE
        at = None if look.picture is None else attributes.get(f"TEXCOORD_{look.picture.uv_set}")
        colors = attributes.get("COLOR_0")
        yield FilePart(
            vertices=gltf.scaled(attributes["POSITION"]),
            faces=_triangles(gltf, part),
            look=look,
            uv=None if at is None else gltf.scaled(at),
            colors=None if colors is None else gltf.scaled(colors),
        )


def _triangles(gltf: GltfFile, part: Mapping[str, Any]) -> NDArray[np.int32]:
    """Return the triangles of a primitive by its mode (3.7.2.1)."""
    if "indices" in part:
        values = gltf.values(part["indices"])
        if part.get("mode", _TRIANGLES) != _TRIANGLES and values.max(initial=0) == _most(values):
            raise UnsupportedMeshError("its strips begin anew by an index, which is not permitted")
        order = values.reshape(-1).astype(np.int64)
    else:
        order = np.arange(gltf.document["accessors"][part["attributes"]["POSITION"]]["count"])
    mode = part.get("mode", _TRIANGLES)
    if mode == _TRIANGLES:
        if len(order) % 3:
            raise UnsupportedMeshError(f"its triangles have {len(order)} corners: it is cut off")
        return order.reshape(-1, 3).astype(np.int32)
    if len(order) < len("xyz"):
        return np.empty((0, 3), np.int32)
    if mode == _FAN:
        triangles = np.stack([np.full(len(order) - 2, order[0]), order[1:-1], order[2:]], axis=1)
    else:
        triangles = np.stack([order[:-2], order[1:-1], order[2:]], axis=1)
        triangles[1::2] = triangles[1::2, [1, 0, 2]]
    return triangles.astype(np.int32)


def _most(indices: NDArray[Any]) -> int:
    return int(np.iinfo(indices.dtype).max)


_WHITE: SurfaceLook = SurfaceLook(NO_LOOK.name, (1.0, 1.0, 1.0), is_linear=True)
"""Of a primitive without a material (3.7.2.1)."""
