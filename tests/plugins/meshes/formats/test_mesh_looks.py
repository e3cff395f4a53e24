"""Looks of mesh files: each surface has the colour that its file gives it, or is named."""

import base64
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from tests.plugins.meshes.tiny_gltf import gltf
from wil_campaign.plugins.meshes.mesh_reader import load_mesh_shape
from wil_campaign.worlds.scene.mesh_formats import MeshFileError
from wil_campaign.worlds.scene.meshes import Mesh

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
FACES = "f 1/1 2/2 3/3 4/4\n"
BLUE = (0, 0, 255)
DATA = base64.b64encode(
    np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32).tobytes()
    + np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32).tobytes()
    + np.array([[0.5, 0.5]] * 4, np.float32).tobytes()
    + np.array([[1, 0, 0, 1], [1, 0, 0, 1], [0, 0, 1, 1], [0, 0, 1, 1]], np.float32).tobytes()
    + np.array([[128, 255, 0, 255]] * 4, np.uint8).tobytes()
    + np.array([0, 1, 2, 0, 2, 3], np.uint16).tobytes()
).decode()


def picture(path: Path, *, alpha: int | None = None) -> Path:
    """Red and green above blue and white, (left, right); alpha: of the red quarter."""
    rgba = np.full((8, 8, 4), 255, np.uint8)
    rgba[:4, :4, :3], rgba[:4, 4:, :3], rgba[4:, :4, :3] = (255, 0, 0), (0, 255, 0), BLUE
    if alpha is not None:
        rgba[:4, :4, 3] = alpha
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(rgba if alpha is not None else rgba[:, :, :3]).save(path)
    return path


def color_at(mesh: Mesh, x: float, y: float) -> tuple[int, ...]:
    """Return the colour of a square in the plane of its first two axes, at a place of it."""
    at = np.array([x, -y])
    for face, material in zip(mesh.faces, mesh.face_material, strict=True):
        a, b, c = mesh.vertices_m[face][:, :2]
        first, second = np.linalg.solve(np.stack([b - a, c - a], axis=1), at - a)
        if min(first, second, 1.0 - first - second) >= 0.0:
            texture = mesh.materials[material].texture
            if texture is None:
                red, green, blue = mesh.materials[material].rgb
                return red, green, blue
            weights = np.array([1.0 - first - second, first, second])
            u, v = (weights @ mesh.uv[face]) % 1.0
            texel = texture[int(v * texture.shape[0]), int(u * texture.shape[1])][::-1]
            red, green, blue = np.rint(texel * mesh.materials[material].rgb / 255.0)
            return int(red), int(green), int(blue)
    raise AssertionError("no face there")


def quarters(mesh: Mesh) -> list[tuple[int, ...]]:
    """Return the colours of a square: top left and right, bottom left and right."""
    return [color_at(mesh, x, y) for y in (0.76, 0.26) for x in (0.24, 0.74)]


UPRIGHT = [(255, 0, 0), (0, 255, 0), BLUE, (255, 255, 255)]


def obj(folder: Path, material: str, faces: str = FACES, *, text: str = SQUARE) -> Mesh:
    (folder / "a.mtl").write_text(f"newmtl m\n{material}\n")
    (folder / "a.obj").write_text(f"mtllib a.mtl\n{text}usemtl m\n{faces}")
    return load_mesh_shape(folder / "a.obj").mesh


def refused(path: Path) -> str:
    with pytest.raises(MeshFileError) as error:
        load_mesh_shape(path)
    return str(error.value)


def refused_obj(folder: Path, material: str, faces: str = FACES, *, text: str = SQUARE) -> str:
    with pytest.raises(MeshFileError) as error:
        obj(folder, material, faces, text=text)
    return str(error.value)


@pytest.mark.parametrize(
    ("place", "written"),
    [
        ("t.png", "t.png"),
        ("../textures/t.png", "../textures/t.png"),
        ("../textures/t.png", "..\\textures\\t.png"),
        ("../materials/textures/t.png", "t.png"),
        ("a b.png", "a b.png"),
        ("t%20.png", "t%20.png"),
        ("t.tga", "t.tga"),
        ("t.png", "-bm 1 -blendu on t.png"),
        ("t.png", "-s 1 1 1 -o 0 0 0 -mm 0 1 -texres 8 t.png"),
        ("t.png", "-o 1 t.png"),
        ("t.png", "-clamp on t.png"),
    ],
)
def test_an_obj_finds_its_picture(tmp_path: Path, place: str, written: str) -> None:
    folder = tmp_path / "meshes"
    folder.mkdir()
    picture(folder / place)
    assert quarters(obj(folder, f"Kd 1 1 1\nmap_Kd {written}")) == UPRIGHT


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ("-s 2 2", [BLUE] * 4),
        ("-o 0.5 0", [UPRIGHT[1], UPRIGHT[0], UPRIGHT[3], UPRIGHT[2]]),
        ("-o 0 0.5 0", [UPRIGHT[2], UPRIGHT[3], UPRIGHT[0], UPRIGHT[1]]),
        ("-mm 0 0.2", [(51, 0, 0), (0, 51, 0), (0, 0, 51), (51, 51, 51)]),
        ("-mm 0.2 1", [(255, 51, 51), (51, 255, 51), (51, 51, 255), (255, 255, 255)]),
    ],
)
def test_options_of_a_picture_count(
    tmp_path: Path, options: str, expected: list[tuple[int, ...]]
) -> None:
    picture(tmp_path / "t.png")
    mesh = obj(tmp_path, f"map_Kd {options} t.png")
    if options == "-s 2 2":
        assert [color_at(mesh, x, y) for x in (0.12, 0.62) for y in (0.12, 0.62)] == expected
    else:
        assert quarters(mesh) == expected


@pytest.mark.parametrize(
    ("material", "said"),
    [
        ("map_Kd none.png", "material 'm' names the image 'none.png': no such file"),
        ("map_Kd /etc/t.png", "which is not beside it or below one of the 3 folders above"),
        ("map_Kd C:\\art\\t.png", "which is not beside it or below one of the 3 folders above"),
        ("map_Kd ../../../../t.png", "which is not beside it or below one of the 3 folders above"),
        ("map_Kd -t 1 1 1 t.png", "material 'm' has turbulence"),
        ("map_Kd -shine 1 t.png", "material 'm' has the option -shine: unknown"),
        ("map_Kd -clamp on -s 2 2 t.png", "the texture of material 'm' is not repeated"),
        ("map_Ka t.png", "material 'm' has no diffuse colour or texture"),
        ("Kd spectral a.rfl", "material 'm' has its colour as 'spectral'"),
        ("Kd 1 x 1", "material 'm' is damaged"),
        ("Kd 1 0 0\nd 0.4", "material 'm' is transparent (alpha 0.4)"),
        ("Kd 1 0 0\nTr 0.7", "material 'm' is transparent (alpha 0.3)"),
        ("map_Kd t.png\nmap_d clear.png", "material 'm' is transparent (alpha 0.39)"),
        ("map_Kd text.png", "the image 'text.png' of material 'm' cannot be decoded"),
    ],
)
def test_a_material_of_an_obj_that_is_not_drawn_is_named(
    tmp_path: Path, material: str, said: str
) -> None:
    picture(tmp_path / "t.png")
    picture(tmp_path / "clear.png", alpha=100)
    (tmp_path / "text.png").write_text("no image")
    assert said in refused_obj(tmp_path, material)


@pytest.mark.parametrize("end", ["d 1", "Tr 0", "Tr 1.0", "d 1.0\nTr 1.0", "map_d t.png"])
def test_an_opaque_material_is_not_refused(tmp_path: Path, end: str) -> None:
    Image.fromarray(np.full((8, 8), 255, np.uint8)).save(tmp_path / "t.png")
    assert obj(tmp_path, f"Kd 0 0 1\n{end}").materials[0].rgb == BLUE


def test_every_library_of_an_obj_counts(tmp_path: Path) -> None:
    for name, rgb in (("a", "1 0 0"), ("b", "0 0 1"), ("c d", "0 1 0")):
        (tmp_path / f"{name}.mtl").write_text(f"newmtl {name[-1]}\nKd {rgb}\n")
    (tmp_path / "a.obj").write_text(
        f"mtllib a.mtl b.mtl\n{SQUARE}mtllib c d.mtl\nusemtl b\nf 1 2 3\nusemtl d\nf 1 3 4\n"
    )
    mesh = load_mesh_shape(tmp_path / "a.obj").mesh
    assert [material.rgb for material in mesh.materials] == [BLUE, (0, 255, 0)]
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\n{SQUARE}usemtl b\nf 1 2 3\n")
    assert "faces use the material 'b', which its libraries do not have" in refused(
        tmp_path / "a.obj"
    )


def test_a_texture_takes_the_colour_of_its_material(tmp_path: Path) -> None:
    """Black is what exporters write that mean the texture alone."""
    cv2.imwrite(str(tmp_path / "t.png"), np.full((4, 4, 3), 255, np.uint8))
    assert quarters(obj(tmp_path, "Kd 1 0 0\nmap_Kd t.png")) == [(255, 0, 0)] * 4
    assert quarters(obj(tmp_path, "Kd 0 0 0\nmap_Kd t.png")) == [(255, 255, 255)] * 4


def test_colours_of_vertices_and_a_material_are_multiplied(tmp_path: Path) -> None:
    colored = SQUARE
    for corner in ("0 0 0", "1 0 0", "1 1 0", "0 1 0"):
        colored = colored.replace(f"v {corner}\n", f"v {corner} 0 0.5 1\n")
    assert obj(tmp_path, "Kd 1 1 0.2", text=colored).materials[0].rgb == (0, 128, 51)
    picture(tmp_path / "t.png")
    assert quarters(obj(tmp_path, "map_Kd t.png", text=colored))[3] == (0, 128, 255)
    mixed = colored.replace("0 0 0 0 0.5 1", "0 0 0 1 0 0", 1)
    assert len(obj(tmp_path, "Kd 1 1 1", text=mixed, faces="f 1 2 3\nf 1 3 4\n").materials) == 1
    said = refused_obj(tmp_path, "map_Kd t.png", "f 1/1 2/2 3/3\nf 2/2 3/3 4/4\n", text=mixed)
    assert "material 'm' has a texture and different colours of vertices" in said


def test_faces_without_places_on_their_texture_are_refused(tmp_path: Path) -> None:
    picture(tmp_path / "t.png")
    said = "material 'm' has a texture, and faces with it have no places on it"
    for faces in ("f 1 2 3\n", "f 1/1 2/2 3/3\nf 1 3 4\n", "vn 0 0 1\nf 1//1 3//1 4//1\n"):
        assert said in refused_obj(tmp_path, "map_Kd t.png", faces)
    assert "a face refers to texture place 9" in refused_obj(
        tmp_path, "map_Kd t.png", "f 1/1 2/2 3/9\n"
    )


def textured(folder: Path, material: dict[str, Any], **changes: Any) -> Path:
    """Write a square: its places in sets 0 (upright) and 1 (the middle), colours red and blue."""
    accessors = [
        {"bufferView": view, "componentType": kind, "count": count, "type": shape, **more}
        for view, (kind, count, shape, more) in enumerate(
            [
                (5126, 4, "VEC3", {}),
                (5126, 4, "VEC2", {}),
                (5126, 4, "VEC2", {}),
                (5126, 4, "VEC4", {}),
                (5121, 4, "VEC4", {"normalized": True}),
                (5123, 6, "SCALAR", {}),
            ]
        )
    ]
    sizes = [48, 32, 32, 64, 16, 12]
    attributes = {"POSITION": 0, "TEXCOORD_0": 1, "TEXCOORD_1": 2, **changes.pop("attributes", {})}
    path = folder / "a.gltf"
    document = json.loads(
        gltf(
            buffers=[{"uri": f"data:;base64,{DATA}", "byteLength": sum(sizes)}],
            bufferViews=[
                {"buffer": 0, "byteOffset": sum(sizes[:k]), "byteLength": size}
                for k, size in enumerate(sizes)
            ],
            accessors=accessors,
            meshes=[{"primitives": [{"attributes": attributes, "indices": 5, "material": 0}]}],
            materials=[{"name": "paint", **material}],
            textures=[{"source": 0, **({"sampler": 0} if "samplers" in changes else {})}],
            images=[{"uri": "t.png"}],
        )
    )
    path.write_text(json.dumps({**document, **changes}))
    return path


def gltf_quarters(path: Path) -> list[tuple[int, ...]]:
    """Return the quarters of a square of a glTF file, which has y up and z forward."""
    shape = load_mesh_shape(path, axes=None).mesh
    turned = shape.vertices_m[:, [1, 2, 0]] * (-1.0, 1.0, 1.0)
    moved = Mesh(turned, shape.normals, shape.uv, shape.faces, shape.face_material, shape.materials)
    return quarters(moved)


def base(**info: Any) -> dict[str, Any]:
    return {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, **info}}}


def transform(**how: Any) -> dict[str, Any]:
    return base(extensions={"KHR_texture_transform": how})


MIRRORED = {"samplers": [{"wrapS": 33648}]}
CLAMPED = {"samplers": [{"wrapT": 33071}]}


@pytest.mark.parametrize(
    ("material", "changes", "expected"),
    [
        (base(), {}, UPRIGHT),
        (base(texCoord=1), {}, [UPRIGHT[3]] * 4),
        (transform(offset=[0.5, 0.0]), {}, [UPRIGHT[1], UPRIGHT[0], UPRIGHT[3], UPRIGHT[2]]),
        # The lower left quarter of the image, as in the extension's own example.
        (transform(offset=[0, 1], rotation=np.pi / 2, scale=[0.5, 0.5]), {}, [BLUE] * 4),
        (transform(rotation=np.pi / 2), {}, [UPRIGHT[2], UPRIGHT[0], UPRIGHT[3], UPRIGHT[1]]),
        (transform(texCoord=1), {}, [UPRIGHT[3]] * 4),
        (transform(offset=[1, 0]), MIRRORED, [UPRIGHT[1], UPRIGHT[0], UPRIGHT[3], UPRIGHT[2]]),
        (base(), CLAMPED, UPRIGHT),
        (base(), {"images": [{"uri": "%74.png"}]}, UPRIGHT),
        ({**base(), "alphaMode": "BLEND"}, {}, UPRIGHT),
        ({"pbrMetallicRoughness": {}}, {"attributes": {"COLOR_0": 4}}, [(188, 255, 0)] * 4),
        (
            {"pbrMetallicRoughness": {"baseColorFactor": [0, 1, 1, 1]}},
            {"attributes": {"COLOR_0": 4}},
            [(0, 255, 0)] * 4,
        ),
        (
            {
                "extensions": {
                    "KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0, 0, 1, 1]}
                }
            },
            {},
            [BLUE] * 4,
        ),
    ],
    ids=[
        *("plain", "set 1", "offset", "example", "rotation", "set of the transform", "mirrored"),
        *("clamped within", "percent", "blend of opaque", "colours", "colours and factor", "gloss"),
    ],
)
def test_a_gltf_surface_looks_as_its_material_says(
    tmp_path: Path,
    material: dict[str, Any],
    changes: dict[str, Any],
    expected: list[tuple[int, ...]],
) -> None:
    picture(tmp_path / "t.png")
    assert gltf_quarters(textured(tmp_path, material, **changes)) == expected


@pytest.mark.parametrize(
    ("material", "changes", "said"),
    [
        (base(texCoord=2), {}, "material 'paint' has a texture, and faces with it have no places"),
        (transform(offset=[0, 1]), CLAMPED, "the texture of material 'paint' is not repeated"),
        (base(), {"images": [{"uri": "../none.png"}]}, "material 'paint' names the image"),
        (base(), {"images": [{"uri": "/t.png"}]}, "material 'paint' names the image '/t.png', whi"),
        (
            base(),
            {"textures": [{"extensions": {"KHR_texture_basisu": {"source": 0}}}]},
            "the texture of material 'paint' has no image that is read (extensions: KHR_texture_b",
        ),
        (base(), {"attributes": {"COLOR_0": 3}}, "material 'paint' has a texture and different"),
        ({"extensions": {"ACME_paint": {}}}, {}, "material 'paint' has the glTF extension ACME_p"),
        (
            {"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.3]}, "alphaMode": "BLEND"},
            {},
            "material 'paint' is transparent (alpha 0.3)",
        ),
        (
            {"extensions": {"KHR_materials_transmission": {"transmissionFactor": 0.9}}},
            {},
            "material 'paint' is transparent (alpha 0.1)",
        ),
        (
            {**base(), "alphaMode": "MASK"},
            {"images": [{"uri": "holes.png"}]},
            "material 'paint' has cut-outs (alpha 0)",
        ),
        (
            {**base(), "alphaMode": "BLEND"},
            {"images": [{"uri": "holes.png"}]},
            "material 'paint' is transparent (alpha 0)",
        ),
    ],
)
def test_a_gltf_material_that_is_not_drawn_is_named(
    tmp_path: Path, material: dict[str, Any], changes: dict[str, Any], said: str
) -> None:
    picture(tmp_path / "t.png")
    picture(tmp_path / "holes.png", alpha=0)
    assert refused(textured(tmp_path, material, **changes)).startswith(said)


def test_a_transparent_material_is_drawn_as_opaque_where_the_world_says_so(tmp_path: Path) -> None:
    picture(tmp_path / "t.png", alpha=0)
    path = textured(tmp_path, {**base(), "alphaMode": "MASK"})
    mesh = load_mesh_shape(path, draws_transparent=True).mesh
    assert mesh.materials[0].texture is not None
    assert mesh.materials[0].texture[0, 0].tolist() == [0, 0, 255]
    opaque = textured(tmp_path, {**base(), "alphaMode": "OPAQUE"})
    assert gltf_quarters(opaque) == UPRIGHT


COLLADA = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><up_axis>Z_UP</up_axis></asset>
<library_images><image id="im"><init_from>{image}</init_from></image></library_images>
<library_effects><effect id="fx"><profile_COMMON>
<newparam sid="sf"><surface type="2D"><init_from>im</init_from></surface></newparam>
<newparam sid="sp"><sampler2D><source>sf</source>{wrap}</sampler2D></newparam>
<technique sid="common"><lambert>{look}</lambert></technique></profile_COMMON></effect>
</library_effects>
<library_materials><material id="mt" name="paint"><instance_effect url="#fx"/></material>
</library_materials><library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="12">0 0 0 1 0 0 1 1 0 0 1 0</float_array>
<technique_common><accessor source="#pa" count="4" stride="3"><param name="X"/><param name="Y"/>
<param name="Z"/></accessor></technique_common></source>
<source id="t0"><float_array id="ta" count="8">0 0 1 0 1 1 0 1</float_array><technique_common>
<accessor source="#ta" count="4" stride="2"><param name="S"/><param name="T"/></accessor>
</technique_common></source>
<source id="t1"><float_array id="tb" count="8">.7 .7 .7 .7 .7 .7 .7 .7</float_array>
<technique_common><accessor source="#tb" count="4" stride="2"><param name="S"/><param name="T"/>
</accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="2" material="M"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="TEXCOORD" source="#t0" offset="0" set="0"/>
<input semantic="TEXCOORD" source="#t1" offset="0" set="1"/><p>0 1 2 0 2 3</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"><bind_material>
<technique_common><instance_material symbol="M" target="#mt"><bind_vertex_input semantic="UV"
input_semantic="TEXCOORD" input_set="{set}"/></instance_material></technique_common>
</bind_material></instance_geometry></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""
TEXTURE = '<diffuse><texture texture="sp" texcoord="UV"/></diffuse>'
RED = "<diffuse><color>1 0 0 1</color></diffuse>"


def collada(folder: Path, look: str = TEXTURE, **changes: str) -> Path:
    values = {"image": "t.png", "wrap": "", "set": "0", "look": look, **changes}
    path = folder / "a.dae"
    path.write_text(COLLADA.format(**values))
    return path


def clear(amount: str, color: str = "1 1 1 1", opaque: str = "A_ONE") -> str:
    return (
        f'{RED}<transparent opaque="{opaque}"><color>{color}</color></transparent><transparency>'
        f"<float>{amount}</float></transparency>"
    )


@pytest.mark.parametrize(
    ("look", "changes", "expected"),
    [
        (TEXTURE, {}, UPRIGHT),
        (TEXTURE, {"image": "../b/a%20t.png"}, UPRIGHT),
        (TEXTURE, {"image": "..\\b\\a t.png"}, UPRIGHT),
        (TEXTURE, {"set": "1"}, [UPRIGHT[1]] * 4),
        (TEXTURE.replace('"sp"', '"im"'), {}, UPRIGHT),
        (RED, {}, [UPRIGHT[0]] * 4),
        (clear("1"), {}, [UPRIGHT[0]] * 4),
        (clear("0", "0 0 0 1", "RGB_ZERO"), {}, [UPRIGHT[0]] * 4),
        (clear("1", "0 0 0 1", "RGB_ZERO"), {}, [UPRIGHT[0]] * 4),
        (clear("0"), {}, [UPRIGHT[0]] * 4),
    ],
)
def test_a_collada_surface_looks_as_its_material_says(
    tmp_path: Path, look: str, changes: dict[str, str], expected: list[tuple[int, ...]]
) -> None:
    folder = tmp_path / "meshes"
    picture(folder / "t.png")
    picture(tmp_path / "b" / "a t.png")
    assert quarters(load_mesh_shape(collada(folder, look, **changes)).mesh) == expected


@pytest.mark.parametrize(
    ("look", "changes", "said"),
    [
        (TEXTURE, {"image": "file:///pics/t.png"}, "material 'paint' names the image 'file:///pi"),
        (TEXTURE, {"image": "none.png"}, "material 'paint' names the image 'none.png': no such"),
        (TEXTURE, {"set": "7"}, "material 'paint' has a texture, and faces with it have no places"),
        (TEXTURE.replace('"sp"', '"no"'), {}, "material 'paint' has the image 'no', which does"),
        (clear("0.25"), {}, "material 'paint' is transparent (alpha 0.25)"),
        (clear("0.9", opaque="RGB_ZERO"), {}, "material 'paint' is transparent (alpha 0.1)"),
        (
            f'{TEXTURE}<transparent><texture texture="sp" texcoord="UV"/></transparent>',
            {"image": "holes.png"},
            "material 'paint' is transparent (alpha 0)",
        ),
    ],
)
def test_a_collada_material_that_is_not_drawn_is_named(
    tmp_path: Path, look: str, changes: dict[str, str], said: str
) -> None:
    picture(tmp_path / "t.png")
    picture(tmp_path / "holes.png", alpha=0)
    assert said in refused(collada(tmp_path, look, **changes))


PLY = (
    "ply\nformat ascii 1.0\ncomment TextureFile {name}\nelement vertex 4\nproperty float x\n"
    "property float y\nproperty float z\nproperty float s\nproperty float t\n{colors}"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0 0 0{rgb}\n1 0 0 1 0{rgb}\n1 1 0 1 1{rgb}\n0 1 0 0 1{rgb}\n4 0 1 2 3\n"
)
RGB = "property uchar red\nproperty uchar green\nproperty uchar blue\n"


def test_a_ply_has_its_texture_or_its_colours(tmp_path: Path) -> None:
    folder, path = tmp_path / "meshes", tmp_path / "meshes" / "a.ply"
    picture(tmp_path / "t.png")
    folder.mkdir()
    path.write_text(PLY.format(name="../t.png", colors="", rgb=""))
    assert quarters(load_mesh_shape(path).mesh) == UPRIGHT
    path.write_text(PLY.format(name="none.png", colors="", rgb=""))
    assert "it names the image 'none.png': no such file" in refused(path)
    plain = PLY.replace("comment TextureFile {name}\n", "")
    path.write_text(plain.format(colors=RGB, rgb=" 0 0 255"))
    assert quarters(load_mesh_shape(path).mesh) == [BLUE] * 4
