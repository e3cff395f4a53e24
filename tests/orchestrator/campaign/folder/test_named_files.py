"""What a campaign names and what that names in its turn: it may not change between its runs."""

import json
from pathlib import Path

import pytest
import trimesh

from tests.orchestrator.hover import WORLD, write_hover
from wil_campaign.campaigns.expansion.expansion import load_campaign
from wil_campaign.foundation.files.documents import Data
from wil_campaign.orchestrator.campaign.folder.manifest import campaign_manifest, world_digest
from wil_campaign.orchestrator.campaign.folder.named_files import named_files


def write_crate(folder: Path, height_m: float) -> None:
    """Write a mesh of which the geometry stands in files beside it, as glTF has it."""
    mesh = trimesh.creation.box((1.0, height_m, 1.0))
    for name, content in trimesh.exchange.gltf.export_gltf(trimesh.Scene(mesh)).items():
        (folder / name.replace("model.gltf", "crate.gltf")).write_bytes(content)


def test_a_mesh_whose_buffers_changed_is_another_world(tmp_path: Path) -> None:
    path = write_hover(tmp_path)
    crate = "  crate: {shape: {mesh: {file: crate.gltf}}, pose: {north_m: 5}}\n"
    (tmp_path / "world.yaml").write_text(f"{WORLD}objects:\n{crate}")
    write_crate(tmp_path, 1.0)
    said = (tmp_path / "crate.gltf").read_bytes()
    campaign = load_campaign(path)
    before, world = (
        campaign_manifest(campaign, "virtual")["files"],
        world_digest(campaign.runs[0].files),
    )
    assert isinstance(before, dict)
    assert {name for name in before if name.endswith(".bin")}
    for one in tmp_path.glob("*.bin"):
        one.write_bytes(bytes(len(one.read_bytes())))
    assert (tmp_path / "crate.gltf").read_bytes() == said
    after = campaign_manifest(campaign, "virtual")["files"]
    assert isinstance(after, dict)
    changed = {name for name in before if before[name] != after[name]}
    assert changed
    assert all(name.endswith(".bin") for name in changed)
    assert world_digest(campaign.runs[0].files) != world


def test_files_that_meshes_name_are_those_that_are_read(tmp_path: Path) -> None:
    """Also of a parent folder, percent-encoded, by backslashes and with options, and no others."""
    meshes = tmp_path / "a" / "b" / "c" / "meshes"
    meshes.mkdir(parents=True)
    images = ("a.png", "b 1.png", "c.webp", "d.png", "e.tga", "f.png", "g.png")
    for name in ("../textures/" + image for image in images):
        (meshes / name).parent.mkdir(exist_ok=True)
        (meshes / name).write_bytes(b"image")
    for far in (tmp_path / "secret.png", meshes / "beside.png"):
        far.write_bytes(b"image")
    (meshes / "a.obj").write_text("mtllib a.mtl\nmtllib b.mtl\nv 0 0 0\n")
    (meshes / "a.mtl").write_text("newmtl a\nmap_Kd -s 2 2 2 ../textures/a.png\nmap_d none.png\n")
    (meshes / "b.mtl").write_text(
        "newmtl b\nmap_Kd ..\\textures\\b 1.png\nnewmtl c\nmap_Kd ../../../../secret.png\n"
        f"newmtl d\nmap_Kd {tmp_path}/secret.png\n"
    )
    uris = ("../textures/%63.webp", "data:image/png;base64,", "../textures/d.png")
    (meshes / "a.gltf").write_text(
        json.dumps({"asset": {}, "images": [{"uri": one} for one in uris], "buffers": [{}]})
    )
    (meshes / "a.dae").write_text(
        "<COLLADA><library_images><image><init_from>../textures/e.tga</init_from></image><image>"
        "<init_from><ref>..\\textures\\f.png</ref></init_from></image></library_images></COLLADA>"
    )
    (meshes / "a.ply").write_text("ply\ncomment TextureFile ../textures/g.png\nend_header\n")
    (meshes / "b.dae").write_text("<COLLADA> beside.png")
    written = [f"a/b/c/meshes/{name}" for name in ("a.obj", "a.gltf", "a.dae", "a.ply", "b.dae")]
    found = named_files([*written], tmp_path / "world.yaml")
    names = {one.name for one in found}
    assert names == {*images, "a.obj", "a.mtl", "b.mtl", "a.gltf", "a.dae", "a.ply", "b.dae"}


@pytest.mark.parametrize(
    ("text", "files"),
    [
        ("fly", {"fly"}),
        ("bin/fly", {"bin/fly"}),
        ("still.py:Still", {"still.py"}),
        ("flight", {"flight/1.png", "flight/2.PNG"}),
        ("build", {"build/bin/px4"}),
        ("nothing", set[str]()),
        (".", set[str]()),
        ("..", set[str]()),
        ("", set[str]()),
        ("x" * 5000, set[str]()),
        ("~nobody-of-this-name/fly", set[str]()),
    ],
)
def test_programs_firmware_and_pictures_are_files_that_a_text_names(
    tmp_path: Path, text: str, files: set[str]
) -> None:
    for name in ("fly", "bin/fly", "still.py", "flight/1.png", "flight/2.PNG", "flight/notes.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(name)
    (tmp_path / "build" / "bin").mkdir(parents=True)
    (tmp_path / "build" / "bin" / "px4").write_text("firmware")
    (tmp_path / "picture.png").write_text("beside the campaign")
    found = named_files({"use": [text]}, tmp_path / "campaign.yaml")
    assert {one.relative_to(tmp_path.resolve()).as_posix() for one in found} == files


def test_a_key_that_signs_a_link_leaves_no_digest(tmp_path: Path) -> None:
    (tmp_path / "key").write_text("passphrase: a word that can be guessed")
    (tmp_path / "firmware").write_text("firmware")
    document: Data = {"real": {"signing": {"file": "key"}, "use": "firmware"}}
    found = list(named_files(document, tmp_path / "campaign.yaml"))
    assert [one.name for one in found] == ["firmware"]
