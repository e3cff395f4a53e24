"""What is said of a mesh file that is damaged: by the format's rules, never a library's insides."""

import contextlib
from pathlib import Path

import pytest
import trimesh

from wil_campaign.foundation.files.problems import closest_file
from wil_campaign.plugins.meshes.mesh_reader import load_mesh_shape
from wil_campaign.worlds.scene.mesh_formats import MeshFileError

KINDS = ("obj", "stl", "glb", "gltf", "dae", "ply")
LFS = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"


def whole(suffix: str) -> bytes:
    data = trimesh.creation.box((1.0, 1.0, 1.0)).export(file_type=suffix)
    assert isinstance(data, bytes)
    return data


def damage_of(path: Path, data: bytes) -> str:
    path.write_bytes(data)
    with pytest.raises(MeshFileError) as error:
        load_mesh_shape(path)
    return str(error.value)


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("a.glb", b"", "it is empty"),
        ("a.glb", b"solid x", "it is not a GLB file: it does not begin with 'glTF'"),
        ("a.glb", whole("glb")[:15], "it is cut off after 15 bytes"),
        ("a.glb", whole("glb")[:-40], "bytes are there"),
        ("a.glb", whole("glb")[:20] + b"!" + whole("glb")[21:], "its description is not JSON"),
        (
            "a.glb",
            whole("glb")[:4] + b"\7" + whole("glb")[5:],
            "it is of glTF version 7; only version 2 is supported",
        ),
        ("a.gltf", b'{"asset": \n {"version": }}', "it is not JSON (line 2, column 14)"),
        ("a.gltf", b"{}", "it is JSON but not glTF"),
        (
            "a.gltf",
            b'{"asset": {"version": "1.0"}, "nodes": {"a": {"meshes": []}}}',
            "it is of glTF version 1.0; only version 2 is supported",
        ),
        *((f"a.{kind}", LFS, "it is a pointer of Git LFS") for kind in KINDS),
        ("a.dae", b"<COLLADA>\n<a></COLLADA>", "it is not XML (line 2, column 6)"),
        ("a.dae", b"<a/>", "it is XML but not Collada"),
        ("a.stl", whole("stl")[:-60], "it is cut off: 10 of 12 facets are there"),
        ("a.stl", b"\0\1", "it is cut off after 2 bytes"),
        ("a.ply", b"\0\1garbage", "it is damaged, or its format does not match its suffix"),
    ],
)
def test_damage_of_a_mesh_file_is_reported_in_our_words(
    tmp_path: Path, name: str, data: bytes, said: str
) -> None:
    text = damage_of(tmp_path / name, data)
    assert text.startswith(("cannot be read as a mesh: it", "it has no triangles: it"))
    assert said in text


@pytest.mark.parametrize("suffix", ["glb", "stl", "ply"])
def test_wherever_a_file_is_cut_it_is_a_fault_or_a_mesh(tmp_path: Path, suffix: str) -> None:
    data = whole(suffix)
    for end in range(0, len(data), max(1, len(data) // 40)):
        path = tmp_path / f"cut.{suffix}"
        path.write_bytes(data[:end])
        with contextlib.suppress(MeshFileError):
            load_mesh_shape(path)


@pytest.mark.parametrize(
    ("name", "known", "meant"),
    [
        ("gaet.obj", ["hall.obj", "tree.obj", "gate.glb"], "gate.glb"),
        ("gate.stl", ["gate.glb", "gate.dae"], "gate.glb"),
        ("gaet.obj", ["gate.glb", "gate.obj", "gate.png"], "gate.obj"),
        ("sky.obj", ["hall.obj", "tree.obj", "box.obj"], ""),
    ],
)
def test_file_names_are_compared_without_their_suffixes(
    name: str, known: list[str], meant: str
) -> None:
    assert closest_file(name, known) == meant
