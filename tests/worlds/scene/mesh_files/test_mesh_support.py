"""glTF files of which trimesh leaves out or misreads something: refused with what to export."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.worlds.scene.tiny_gltf import gltf
from worlds.scene.mesh_files.mesh_reader import MeshFileError, load_mesh_shape

DRACO = "KHR_draco_mesh_compression"
ACCESSORS: list[dict[str, Any]] = json.loads(gltf())["accessors"]
CORNERS, INDICES = ACCESSORS
BARE = {key: value for key, value in CORNERS.items() if key != "bufferView"}
SPARSE = {"count": 1, "indices": {"bufferView": 1, "componentType": 5123}, "values": {}}
PART = {"attributes": {"POSITION": 0}, "indices": 1}


def primitive(**changes: Any) -> dict[str, Any]:
    return {"meshes": [{"primitives": [{**PART, **changes}]}]}


def colored(**accessor: Any) -> dict[str, Any]:
    color = {"bufferView": 0, "count": 3, "type": "VEC3", "normalized": True, **accessor}
    part = primitive(attributes={"POSITION": 0, "COLOR_0": 2})
    return {**part, "accessors": [*ACCESSORS, color]}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"extensionsRequired": [DRACO], "accessors": [BARE, INDICES]},
            f"it requires the glTF extension {DRACO}",
        ),
        (
            {"extensionsRequired": ["KHR_mesh_quantization", "EXT_meshopt_compression"]},
            "it requires the glTF extension EXT_meshopt_compression",
        ),
        ({"accessors": [BARE, INDICES]}, "its POSITION data are compressed or sparse"),
        ({"accessors": [{**CORNERS, "sparse": SPARSE}, INDICES]}, "its POSITION data are"),
        ({"accessors": [CORNERS, {**INDICES, "sparse": SPARSE}]}, "its indices data are"),
        (
            {"accessors": [{**CORNERS, "componentType": 5122, "normalized": True}, INDICES]},
            "its POSITION data are normalized integers",
        ),
        (
            {
                **primitive(attributes={"POSITION": 0, "TEXCOORD_0": 2}, material=0),
                "accessors": [
                    *ACCESSORS,
                    {**CORNERS, "type": "VEC2", "componentType": 5121, "normalized": True},
                ],
            },
            "its TEXCOORD_0 data are normalized integers",
        ),
        (colored(componentType=5123), "its COLOR_0 data are normalized integers"),
        (primitive(mode=6), "it has a triangle fan"),
    ],
    ids=[
        *("draco", "meshopt", "no buffer", "sparse corners", "sparse indices", "short corners"),
        *("byte texture places", "short colours", "fan"),
    ],
)
def test_what_would_be_misread_is_refused(
    tmp_path: Path, changes: dict[str, Any], said: str
) -> None:
    path = tmp_path / "a.gltf"
    path.write_text(gltf(**changes))
    with pytest.raises(MeshFileError) as error:
        load_mesh_shape(path)
    assert str(error.value).startswith(said)
    assert "export" in str(error.value)


@pytest.mark.parametrize(
    "changes",
    [
        {"extensionsRequired": ["KHR_mesh_quantization", "KHR_materials_unlit"]},
        {"extensionsUsed": [DRACO]},
        primitive(mode=5),
        colored(componentType=5121),
        {**colored(componentType=5126), "extensionsRequired": []},
        {"meshes": [{"primitives": [PART, {"mode": 1, "attributes": {"POSITION": 0}}]}]},
    ],
    ids=["extensions", "uncompressed as well", "strip", "byte colours", "colours", "line"],
)
def test_what_is_read_as_it_is_meant_passes(tmp_path: Path, changes: dict[str, Any]) -> None:
    path = tmp_path / "a.gltf"
    path.write_text(gltf(**changes))
    assert len(load_mesh_shape(path).mesh.faces) == 1


def test_an_extension_is_refused_also_where_another_check_finds_damage(tmp_path: Path) -> None:
    path = tmp_path / "a.gltf"
    path.write_text(gltf(extensionsRequired=[DRACO], images=[{"uri": 7}]))
    with pytest.raises(MeshFileError, match="it requires the glTF extension"):
        load_mesh_shape(path)
