"""Small files that state much: refused by what they state, before memory is taken."""

import base64
import json
import struct
import tracemalloc
import zlib
from pathlib import Path
from typing import Any

import pytest

from tests.plugins.meshes.tiny_gltf import gltf
from wil_campaign.foundation.files.images import (
    ImageError,
    decode_image_file,
    image_size,
    read_image,
)
from wil_campaign.foundation.files.limits import MAX_IMAGE_PIXELS
from wil_campaign.plugins.meshes.mesh_reader import load_mesh_shape
from wil_campaign.plugins.meshes.named_by_mesh import files_named_by_mesh
from wil_campaign.worlds.scene.mesh_formats import MeshFileError
from wil_campaign.worlds.scene.textures import load_texture


def png(width: int, height: int) -> bytes:
    """Return an image that is all of one colour: nearly nothing, however large it is."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    rows = zlib.compress(bytes((width + 1) * height), 9)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def refused(path: Path) -> str:
    tracemalloc.start()
    try:
        with pytest.raises(MeshFileError) as error:
            load_mesh_shape(path)
        assert tracemalloc.get_traced_memory()[1] < 300e6
    finally:
        tracemalloc.stop()
    return str(error.value)


def test_a_triangle_is_a_mesh(tmp_path: Path) -> None:
    path = tmp_path / "one.gltf"
    path.write_text(gltf())
    assert load_mesh_shape(path).mesh.faces.shape == (1, 3)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"nodes": [{"mesh": 0}] * 60_000 + [{"children": [*range(60_000)]}] * 2},
            "more than 100000 nodes",
        ),
        (
            {"nodes": [{"mesh": 0}, *({"children": [index, index]} for index in range(40))]},
            "more than 100000 nodes",
        ),
        ({"nodes": [{"children": [0]}]}, "nested more than 100 deep"),
    ],
)
def test_instances_are_counted_before_they_are_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any], said: str
) -> None:
    monkeypatch.setattr("wil_campaign.plugins.meshes.mesh_reader.read_gltf", _load_nothing)
    nodes = changes["nodes"]
    roots = range(60_000, 60_002) if len(nodes) > 100 else [len(nodes) - 1]
    path = tmp_path / "many.gltf"
    path.write_text(gltf(**changes, scenes=[{"nodes": [*roots]}]))
    assert said in refused(path)


def _load_nothing(path: Path) -> None:
    raise AssertionError(f"{path} is loaded")


def test_faces_are_counted_with_all_instances_before_they_are_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wil_campaign.plugins.meshes.mesh_reader.read_gltf", _load_nothing)
    path = tmp_path / "many.gltf"
    index = {"bufferView": 1, "componentType": 5123, "count": 150_000, "type": "SCALAR"}
    document = json.loads(gltf())
    accessors = [document["accessors"][0], index]
    nodes = [{"mesh": 0}] * 11
    path.write_text(gltf(accessors=accessors, nodes=nodes, scenes=[{"nodes": [*range(11)]}]))
    assert "more than 500000 faces" in refused(path)


def test_vertices_that_a_file_only_states_are_not_allocated(tmp_path: Path) -> None:
    path = tmp_path / "large.gltf"
    accessor = {"componentType": 5126, "count": 400_000_000, "type": "VEC3"}
    index = {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"}
    path.write_text(gltf(accessors=[accessor, index]))
    assert "at most 6000000 are read" in refused(path)
    path = tmp_path / "large.ply"
    path.write_text("ply\nformat ascii 1.0\nelement vertex 999999999\nend_header\n")
    assert "at most 6000000 are read" in refused(path)


def test_collada_expands_no_entities_and_counts_instances(tmp_path: Path) -> None:
    path = tmp_path / "laughs.dae"
    entities = "".join(f'<!ENTITY e{index + 1} "{f"&e{index};" * 10}">' for index in range(9))
    path.write_text(f'<!DOCTYPE x [<!ENTITY e0 "ha">{entities}]><COLLADA>&e9;</COLLADA>')
    assert "document type" in refused(path)
    path = tmp_path / "many.dae"
    calls = [10 * f"<instance_node url='#n{index}'/>" for index in range(9)]
    nodes = "".join(f'<node id="n{index + 1}">{call}</node>' for index, call in enumerate(calls))
    path.write_text(
        f'<COLLADA><library_nodes><node id="n0"/>{nodes}</library_nodes><visual_scene><node>'
        '<instance_node url="#n9"/></node></visual_scene></COLLADA>'
    )
    assert "more than 100000 nodes" in refused(path)


def test_a_small_file_with_a_large_picture_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "texture.png"
    path.write_bytes(png(20_000, 20_000))
    assert path.stat().st_size < 500_000
    tracemalloc.start()
    with pytest.raises(ImageError, match="it is 20000 x 20000 px; at most 40000000"):
        load_texture(path)
    assert tracemalloc.get_traced_memory()[1] < 10e6
    tracemalloc.stop()
    image = base64.b64encode(path.read_bytes()).decode()
    material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    mesh = {"attributes": {"POSITION": 0}, "indices": 1, "material": 0}
    inside = tmp_path / "inside.gltf"
    inside.write_text(
        gltf(
            images=[{"uri": f"data:image/png;base64,{image}"}],
            textures=[{"source": 0}],
            materials=[material],
            meshes=[{"primitives": [mesh]}],
        )
    )
    refused(inside)


def test_sizes_are_what_headers_state(tmp_path: Path) -> None:
    import cv2
    import numpy as np

    picture = np.zeros((30, 50, 3), np.uint8)
    for suffix in ("png", "jpg", "bmp", "webp", "tiff", "ppm"):
        path = tmp_path / f"a.{suffix}"
        assert cv2.imwrite(str(path), picture)
        assert image_size(path.read_bytes()) == (50, 30)
        assert read_image(path).shape == (30, 50, 3)
    for data in (b"", b"text", b"\x89PNG\r\n\x1a\n", b"II*\0", b"\xff\xd8\xff\xe0", b"RIFF"):
        with pytest.raises(ImageError, match="not a PNG"):
            decode_image_file(data)
    with pytest.raises(ImageError, match="damaged"):
        decode_image_file(png(10, 10)[:40])
    with pytest.raises(ImageError, match="no such file"):
        read_image(tmp_path / "none.png")
    assert MAX_IMAGE_PIXELS * 8 < 1e9


def test_a_device_is_not_read_for_the_files_that_it_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may have no end: validate filled the memory with /dev/zero."""
    path = tmp_path / "gate.obj"
    path.symlink_to("/dev/null")
    read: list[Path] = []

    def read_bytes(path: Path) -> bytes:
        read.append(path)
        return b""

    monkeypatch.setattr(Path, "read_bytes", read_bytes)
    assert files_named_by_mesh(path) == []
    assert read == []
