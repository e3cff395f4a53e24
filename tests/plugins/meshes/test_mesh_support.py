"""glTF files: every surface of their scene is read where it is, or refused by its node."""

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.plugins.meshes.tiny_gltf import INDICES, TRIANGLE, gltf
from wil_campaign.plugins.meshes.mesh_reader import load_mesh_shape
from wil_campaign.worlds.scene.mesh_formats import MeshFileError

DRACO = "KHR_draco_mesh_compression"
INSTANCING = "EXT_mesh_gpu_instancing"
ACCESSORS: list[dict[str, Any]] = json.loads(gltf())["accessors"]
CORNERS, INDEX = ACCESSORS
BARE = {key: value for key, value in CORNERS.items() if key != "bufferView"}
PART = {"attributes": {"POSITION": 0}, "indices": 1}
TARGET = [{"POSITION": 0}]
VIEWS: list[dict[str, Any]] = json.loads(gltf())["bufferViews"]


def primitive(**changes: Any) -> dict[str, Any]:
    return {"meshes": [{"primitives": [{**PART, **changes}]}]}


def node(**changes: Any) -> dict[str, Any]:
    return {"nodes": [{"mesh": 0, "name": "arm", **changes}]}


def triangles(path: Path) -> list[list[tuple[float, ...]]]:
    """Return the corners of each triangle in the file's axes, by the one that is first."""
    mesh = load_mesh_shape(path).mesh
    corners = mesh.vertices_m[mesh.faces]
    # FRD of y up, z forward: forward is z, right is -x, down is -y.
    xyz = np.stack([-corners[..., 1], -corners[..., 2], corners[..., 0]], axis=-1).round(6) + 0.0
    turned = [[*map(tuple, one.tolist())] for one in xyz]
    return sorted(one[one.index(min(one)) :] + one[: one.index(min(one))] for one in turned)


def written(folder: Path, text: str) -> Path:
    path = folder / "a.gltf"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"extensionsRequired": [DRACO], "accessors": [BARE, INDEX]},
            f"it requires the glTF extension {DRACO}",
        ),
        (
            {"extensionsRequired": ["KHR_mesh_quantization", "EXT_meshopt_compression"]},
            "it requires the glTF extension EXT_meshopt_compression",
        ),
        ({"accessors": [BARE, INDEX]}, "its accessor 0 has no data, which may be compressed"),
        (
            {
                "bufferViews": [
                    {**VIEWS[0], "extensions": {"EXT_meshopt_compression": {}}},
                    VIEWS[1],
                ]
            },
            "bufferView 0 has the glTF extension EXT_meshopt_compression",
        ),
        (
            node(extensions={INSTANCING: {"attributes": {"TRANSLATION": 0}}}),
            f"node 'arm' has instances by {INSTANCING}",
        ),
        (
            node(extensions={"KHR_node_visibility": {"visible": False}}),
            "node 'arm' is hidden by KHR_node_visibility",
        ),
        (
            node(extensions={"ACME_bent_nodes": {}}),
            "node 'arm' has the glTF extension ACME_bent_nodes",
        ),
        (
            {"meshes": [{"name": "leg", "primitives": [{**PART, "extensions": {"ACME_fur": {}}}]}]},
            "mesh 'leg' has the glTF extension ACME_fur",
        ),
        ({**node(skin=0), "skins": [{"joints": [0]}]}, "node 'arm' has a skin"),
        (
            {**node(weights=[0.5]), **primitive(targets=TARGET)},
            "node 'arm' has morph targets with weights",
        ),
        (
            {**node(), "meshes": [{"weights": [1], "primitives": [{**PART, "targets": TARGET}]}]},
            "node 'arm' has morph targets with weights",
        ),
        (node(rotation=[0, 0, 0, 0]), "a node has a rotation of 0 0 0 0"),
        ({"scenes": []}, "it has no scene"),
        (
            {"extensionsUsed": ["CESIUM_RTC"], "extensions": {"CESIUM_RTC": {"center": [9, 0, 0]}}},
            "it has the glTF extension CESIUM_RTC, which is not supported",
        ),
    ],
    ids=[
        *("draco", "meshopt", "no buffer", "meshopt not required", "instances", "hidden"),
        *("node extension", "mesh extension", "skin", "weights", "default weights"),
        *("no rotation", "no scene"),
        "moved",
    ],
)
def test_a_gltf_file_that_would_be_misread_is_refused(
    tmp_path: Path, changes: dict[str, Any], said: str
) -> None:
    with pytest.raises(MeshFileError) as error:
        load_mesh_shape(written(tmp_path, gltf(**changes)))
    assert str(error.value).startswith(said)


@pytest.mark.parametrize(
    "changes",
    [
        {"extensionsRequired": ["KHR_mesh_quantization", "KHR_materials_unlit"]},
        {"extensionsUsed": [DRACO, "ACME_bent_nodes"]},
        primitive(mode=5),
        primitive(mode=6),
        {"meshes": [{"primitives": [PART, {"mode": 1, "attributes": {"POSITION": 0}}]}]},
        node(extensions={"KHR_node_visibility": {"visible": True}, "KHR_lights_punctual": {}}),
        {**node(weights=[0.0]), **primitive(targets=TARGET)},
        {"nodes": [{"mesh": 0, "camera": 0}], "cameras": [{"type": "perspective"}]},
        {"scenes": [{"nodes": []}, {"nodes": [0]}], "scene": 1},
        {"extensions": {"KHR_materials_variants": {"variants": []}, "KHR_lights_punctual": {}}},
    ],
    ids=[
        *("extensions", "used nowhere", "strip", "fan", "line", "shown", "no weight", "camera"),
        *("second scene", "lights"),
    ],
)
def test_a_gltf_file_that_is_read_as_it_is_meant_passes(
    tmp_path: Path, changes: dict[str, Any]
) -> None:
    assert triangles(written(tmp_path, gltf(**changes))) == [[(0, 0, 0), (1, 0, 0), (0, 1, 0)]]


def test_a_file_with_several_scenes_must_name_one(tmp_path: Path) -> None:
    document = json.loads(gltf(scenes=[{"nodes": [0]}, {"nodes": []}]))
    del document["scene"]
    with pytest.raises(MeshFileError, match="it has 2 scenes and does not say which"):
        load_mesh_shape(written(tmp_path, json.dumps(document)))


def packed(**changes: Any) -> str:
    """Return a file with the triangle as normalized shorts, and with a corner moved sparsely."""
    short = struct.pack("<9h2x", 0, 0, 0, 32767, 0, 0, 0, 32767, 0)
    moved = struct.pack("<H2x3f", 1, 2.0, 0.0, 0.0)
    data = base64.b64encode(TRIANGLE + short + moved + INDICES).decode()
    views = [(0, 36), (36, 18), (56, 2), (60, 12), (72, 6)]
    return gltf(
        buffers=[{"uri": f"data:;base64,{data}", "byteLength": 78}],
        bufferViews=[{"buffer": 0, "byteOffset": at, "byteLength": n} for at, n in views],
        accessors=[
            CORNERS,
            {**INDEX, "bufferView": 4},
            {**CORNERS, "bufferView": 1, "componentType": 5122, "normalized": True},
            {
                **CORNERS,
                "sparse": {
                    "count": 1,
                    "indices": {"bufferView": 2, "componentType": 5123},
                    "values": {"bufferView": 3},
                },
            },
        ],
        **changes,
    )


@pytest.mark.parametrize(("accessor", "far"), [(0, 1.0), (2, 1.0), (3, 2.0)])
def test_shorts_and_sparse_data_are_read(tmp_path: Path, accessor: int, far: float) -> None:
    text = packed(**primitive(attributes={"POSITION": accessor}))
    assert triangles(written(tmp_path, text)) == [[(0, 0, 0), (far, 0, 0), (0, 1, 0)]]


def test_nodes_have_their_places_and_a_mirrored_one_keeps_its_outside(tmp_path: Path) -> None:
    half = np.sqrt(0.5)
    nodes = [
        {"children": [1, 2], "translation": [10, 0, 0]},
        {"mesh": 0, "rotation": [0, 0, half, half], "scale": [2, 1, 1]},
        {"children": [3], "matrix": [*(-1, 0, 0, 0), *(0, 1, 0, 0), *(0, 0, 1, 0), *(0, 0, 5, 1)]},
        {"mesh": 0},
    ]
    found = triangles(written(tmp_path, gltf(nodes=nodes)))
    turned = [(9, 0, 0), (10, 0, 0), (10, 2, 0)]
    mirrored = [(9, 0, 5), (10, 0, 5), (10, 1, 5)]
    assert found == [turned, mirrored]


@pytest.mark.parametrize("last", [(0, 0, 0, 2), (5, 0, 0, 1)])
def test_a_matrix_whose_rows_and_columns_are_confused_is_refused(
    tmp_path: Path, last: tuple[int, ...]
) -> None:
    matrix = np.eye(4)
    matrix[3] = last
    nodes = [{"name": "arm", "mesh": 0, "matrix": matrix.T.reshape(-1).tolist()}]
    with pytest.raises(MeshFileError, match="node 'arm' has a matrix whose last row is not 0 0 0"):
        load_mesh_shape(written(tmp_path, gltf(nodes=nodes)))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"buffers": [{**json.loads(gltf())["buffers"][0], "byteLength": 43}]}, "42 of 43 bytes"),
        ({"bufferViews": [{**VIEWS[0], "byteLength": 60}, VIEWS[1]]}, "data lie up to byte 60"),
        ({"accessors": [{**CORNERS, "count": 4}, INDEX]}, "a view of 36 bytes has to have 48"),
        ({"accessors": [CORNERS, {**INDEX, "count": 2}]}, "its triangles have 2 corners"),
        (
            {"buffers": [{"uri": "none.bin", "byteLength": 42}]},
            "names the file 'none.bin': no such",
        ),
    ],
)
def test_a_file_that_lacks_data_is_refused(
    tmp_path: Path, changes: dict[str, Any], said: str
) -> None:
    with pytest.raises(MeshFileError, match=said):
        load_mesh_shape(written(tmp_path, gltf(**changes)))


def test_an_extension_is_refused_also_where_another_check_finds_damage(tmp_path: Path) -> None:
    with pytest.raises(MeshFileError, match="it requires the glTF extension"):
        load_mesh_shape(written(tmp_path, gltf(extensionsRequired=[DRACO], images=[{"uri": 7}])))
