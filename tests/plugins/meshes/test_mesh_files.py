"""Mesh files: axes, units, colours and pictures that they bring, and what they may lack."""

import math
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from tests.plugins.meshes.tiny_gltf import gltf
from wil_campaign.plugins.meshes.mesh_reader import load_mesh_shape
from wil_campaign.plugins.meshes.smoothing import smoothed_mesh
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.render.renderer import Renderer
from wil_campaign.worlds.scene.mesh_formats import MeshFileError
from wil_campaign.worlds.scene.scene import Scene, SceneObject

CORNERS = [[1, 1, -1], [1, -1, -1], [1, -1, 1], [1, 1, 1]]
"""A sheet ahead, x forward and z up: bottom left, bottom right, top right, top left."""
UV = [[0, 0], [1, 0], [1, 1], [0, 1]]
COLLADA = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2026-01-01T00:00:00</created><modified>2026-01-01T00:00:00</modified>
<unit name="centimeter" meter="0.01"/><up_axis>Z_UP</up_axis></asset>
<library_images><image id="i"><init_from>tex.png</init_from></image></library_images>
<library_effects><effect id="fx"><profile_COMMON>
<newparam sid="s"><surface type="2D"><init_from>i</init_from></surface></newparam>
<newparam sid="m"><sampler2D><source>s</source></sampler2D></newparam>
<technique sid="common"><lambert><diffuse><texture texture="m" texcoord="UV"/></diffuse></lambert>
</technique></profile_COMMON></effect></library_effects>
<library_materials><material id="mat"><instance_effect url="#fx"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="12">100 100 -100 100 -100 -100 100 -100 100 100 100 100
</float_array><technique_common><accessor source="#pa" count="4" stride="3">
<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
</accessor></technique_common></source>
<source id="t"><float_array id="ta" count="8">0 0 1 0 1 1 0 1</float_array><technique_common>
<accessor source="#ta" count="4" stride="2"><param name="S" type="float"/>
<param name="T" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="2" material="M"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="TEXCOORD" source="#t" offset="1" set="0"/><p>0 0 1 1 2 2 0 0 2 2 3 3</p>
</triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="vs"><node id="n"><instance_geometry url="#g">
<bind_material><technique_common><instance_material symbol="M" target="#mat"/></technique_common>
</bind_material></instance_geometry></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#vs"/></scene></COLLADA>
"""


def picture(path: Path) -> Image.Image:
    """Red and green above blue and white."""
    rgb = np.full((64, 64, 3), 255, np.uint8)
    rgb[:32, :32], rgb[:32, 32:], rgb[32:, :32] = (255, 0, 0), (0, 255, 0), (0, 0, 255)
    image = Image.fromarray(rgb)
    image.save(path)
    return image


def sheet(folder: Path, name: str) -> Path:
    image, path = picture(folder / "tex.png"), folder / name
    corners = np.array(CORNERS, float)
    if path.suffix == ".dae":
        path.write_text(COLLADA, encoding="utf-8")
        return path
    if path.suffix == ".glb":
        corners = corners[:, [1, 2, 0]]
    material = trimesh.visual.material.SimpleMaterial(image=image, diffuse=(255, 255, 255, 255))
    visual = trimesh.visual.TextureVisuals(np.array(UV, float), material)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    trimesh.Trimesh(corners, faces, process=False, visual=visual).export(path)
    return path


@pytest.mark.parametrize("name", ["s.obj", "s.glb", "s.dae"])
def test_a_sheet_with_a_picture_stands_upright(tmp_path: Path, name: str) -> None:
    """Also that a Collada file's own unit (cm) and axes (z up) count."""
    shape = load_mesh_shape(sheet(tmp_path, name))
    np.testing.assert_allclose(
        sorted(shape.mesh.vertices_m.tolist()), sorted([x, -y, -z] for x, y, z in CORNERS)
    )
    scene = Scene((SceneObject(1, "sheet", shape, Pose.of(1, 0, 0)),))
    camera = Intrinsics.from_fov(64, 64, math.radians(60))
    image = Renderer(scene).render(Pose.of(0, 0, 0), camera, 0.0).image_bgr.astype(int)
    white = image[44, 44]
    assert white.min() > 150
    quarters = [image[20, 20], image[20, 44], image[44, 20]]
    for seen, wanted in zip(quarters, ([0, 0, 1], [0, 1, 0], [1, 0, 0]), strict=True):
        np.testing.assert_array_equal(seen, white * wanted)


def test_a_given_unit_comes_before_the_unit_of_the_file(tmp_path: Path) -> None:
    shape = load_mesh_shape(sheet(tmp_path, "s.dae"), unit="mm")
    assert np.abs(shape.mesh.vertices_m).max() == pytest.approx(0.1)


@pytest.mark.parametrize(("name", "rgb"), [("c.ply", (200, 30, 10)), ("c.glb", (229, 96, 56))])
def test_colours_of_faces_and_corners_are_kept(
    tmp_path: Path, name: str, rgb: tuple[int, int, int]
) -> None:
    """Those of a .glb file are linear."""
    box = trimesh.creation.box((1, 1, 1))
    box.visual.face_colors = [200, 30, 10, 255]
    box.export(tmp_path / name)
    mesh = load_mesh_shape(tmp_path / name).mesh
    assert [material.rgb for material in mesh.materials] == [rgb]


@pytest.mark.parametrize(
    ("factor", "rgb"),
    [
        ([1.0, 0.1878, 0.0, 1.0], (255, 120, 0)),
        ([0.002, 0.5, 1.0, 1.0], (7, 188, 255)),
        (None, (255, 255, 255)),
    ],
    ids=["orange", "dark", "none"],
)
def test_the_colour_of_a_gltf_material_is_linear(
    tmp_path: Path, factor: list[float] | None, rgb: tuple[int, int, int]
) -> None:
    part = {"attributes": {"POSITION": 0}, "indices": 1, "material": 0}
    metal = {} if factor is None else {"baseColorFactor": factor}
    materials = [{"pbrMetallicRoughness": metal}]
    path = tmp_path / "c.gltf"
    path.write_text(gltf(meshes=[{"primitives": [part]}], materials=materials))
    (material,) = load_mesh_shape(path).mesh.materials
    np.testing.assert_allclose(material.rgb, rgb, atol=1)


@pytest.mark.parametrize(
    ("unit", "metres"),
    [('meter="0.01"', 0.01), ("meter = '2.'", 2.0), ('meter\n= "2.54E-2" name="inch"', 0.0254)],
)
def test_the_unit_of_a_collada_file_is_read_however_it_is_written(
    tmp_path: Path, unit: str, metres: float
) -> None:
    path = sheet(tmp_path, "s.dae")
    path.write_text(COLLADA.replace('name="centimeter" meter="0.01"', unit), encoding="utf-8")
    assert np.abs(load_mesh_shape(path).mesh.vertices_m).max() == pytest.approx(100 * metres)


@pytest.mark.parametrize("number", ["0", "-1", "nan", "inf", "1,0", ""])
def test_a_unit_of_a_collada_file_that_is_no_length_is_refused(tmp_path: Path, number: str) -> None:
    path = sheet(tmp_path, "s.dae")
    path.write_text(COLLADA.replace("0.01", number), encoding="utf-8")
    with pytest.raises(MeshFileError, match=r"its unit, meter=.* is not a length in metres"):
        load_mesh_shape(path)


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "glb", "dae"])
def test_a_mesh_of_which_nothing_can_be_seen_is_refused(tmp_path: Path, suffix: str) -> None:
    for corners in ([[1.0, 2, 3]] * 3, [[0.0, 0, 0], [1, 2, 3], [2, 4, 6]]):
        line = trimesh.Trimesh(corners, [[0, 1, 2]], process=False)
        line.export(tmp_path / f"line.{suffix}")
        with pytest.raises(MeshFileError, match="none of its 1 triangles has an area"):
            load_mesh_shape(tmp_path / f"line.{suffix}")


def test_very_many_colours_become_fewer(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(3)
    ball.visual.face_colors = [[k % 256, k // 5, 0, 255] for k in range(1280)]
    ball.export(tmp_path / "b.ply")
    mesh = load_mesh_shape(tmp_path / "b.ply").mesh
    assert len(mesh.materials) <= 64
    rgb = np.array([material.rgb for material in mesh.materials])[mesh.face_material]
    assert np.abs(rgb[:, 0] - np.arange(1280) % 256).max() <= 16


def test_files_that_an_obj_names_must_be_there(tmp_path: Path) -> None:
    path = sheet(tmp_path, "s.obj")
    (library,) = tmp_path.glob("*.mtl")
    pictured = library.read_text(encoding="utf-8")
    library.write_text(pictured + "\nmap_Kd -s 2 2 1 none.png\n", encoding="utf-8")
    with pytest.raises(MeshFileError, match=r"names the image 'none\.png'"):
        load_mesh_shape(path)
    library.unlink()
    with pytest.raises(MeshFileError, match="no such file"):
        load_mesh_shape(path)


def test_an_obj_of_another_encoding_is_read(tmp_path: Path) -> None:
    path = tmp_path / "s.obj"
    text = "# Größe von Björn\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    path.write_bytes(text.encode("latin-1"))
    assert len(load_mesh_shape(path).mesh.faces) == 1


def test_a_mesh_too_large_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wil_campaign.plugins.meshes.mesh_reader.MAX_FACES", 11)
    trimesh.creation.box((1, 1, 1)).export(tmp_path / "b.stl")
    with pytest.raises(MeshFileError, match="more than 11 faces"):
        load_mesh_shape(tmp_path / "b.stl")


def normals_of(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    vertices = np.asarray(mesh.vertices, float)
    old, normals, faces = smoothed_mesh(vertices, np.zeros((len(vertices), 2)), mesh.faces)
    np.testing.assert_array_equal(vertices[old][faces], vertices[mesh.faces])
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    return vertices[old], normals, faces


def test_a_box_keeps_its_edges() -> None:
    _, normals, faces = normals_of(trimesh.creation.box((1, 2, 3)))
    assert len(normals) == 24
    assert sorted(np.abs(normals).max(axis=1)) == [1.0] * 24
    assert (normals[faces[:, 0]] == normals[faces[:, 1]]).all()


@pytest.mark.parametrize("welded", [True, False])
def test_a_ball_is_smooth_however_its_file_is_written(*, welded: bool) -> None:
    ball = trimesh.creation.icosphere(3)
    if not welded:
        ball.unmerge_vertices()
    at, normals, _ = normals_of(ball)
    assert len(at) == 642
    assert np.einsum("ij,ij->i", at, normals).min() > 0.999


def test_a_can_is_smooth_round_and_sharp_at_its_rims() -> None:
    at, normals, _ = normals_of(trimesh.creation.cylinder(0.5, 1.0, sections=32))
    side = np.abs(normals[:, 2]) < 1e-9
    assert side.sum() == 64
    assert (np.abs(normals[~side][:, 2]) == 1.0).all()
    np.testing.assert_allclose(normals[side][:, :2], at[side][:, :2] / 0.5, atol=1e-6)


def test_faces_without_area_are_harmless() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    _, normals, faces = smoothed_mesh(vertices, np.zeros((3, 2)), np.array([[0, 1, 2]], np.int32))
    assert (normals == 0.0).all()
    assert faces.shape == (1, 3)
