"""Collada, .obj, .ply and .stl files: every part is read where it is, or refused by its name."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from wil_campaign.plugins.meshes.mesh_reader import (
    Z_UP,
    load_mesh_shape,
)
from wil_campaign.worlds.scene.mesh_formats import MeshFileError

ASSET = '<asset><unit meter="1"/><up_axis>Z_UP</up_axis></asset>'
SOURCE = (
    '<source id="p"><float_array id="pa" count="12">0 0 0 1 0 0 1 1 0 0 1 0</float_array>'
    '<technique_common><accessor source="#pa" count="4" stride="3"><param name="X"/>'
    '<param name="Y"/><param name="Z"/></accessor></technique_common></source>'
    '<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>'
)
VERTEX = '<input semantic="VERTEX" source="#v" offset="0"/>'
TRIANGLES = f'<triangles count="2">{VERTEX}<p>0 1 2 0 2 3</p></triangles>'
GEOMETRY = f'<geometry id="g" name="wall"><mesh>{SOURCE}{TRIANGLES}</mesh></geometry>'
HERE = '<node id="n" name="arm"><instance_geometry url="#g"/></node>'
SCENE = '<scene><instance_visual_scene url="#s"/></scene>'


def collada(folder: Path, nodes: str = HERE, **changed: str) -> Path:
    """Write a square of 1 m, seen by nodes. changed: geometry, more (libraries), asset, scene."""
    path = folder / "a.dae"
    path.write_text(
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        f"{changed.get('asset', ASSET)}{changed.get('more', '')}<library_geometries>"
        f"{changed.get('geometry', GEOMETRY)}</library_geometries><library_visual_scenes>"
        f'<visual_scene id="s">{nodes}</visual_scene></library_visual_scenes>'
        f"{changed.get('scene', SCENE)}</COLLADA>"
    )
    return path


def corners(path: Path) -> np.ndarray:
    """Return the corners of all triangles, (n, 3, 3), in the file's axes and unit."""
    mesh = load_mesh_shape(path, unit="m", axes=Z_UP).mesh
    return mesh.vertices_m[mesh.faces] * (1.0, -1.0, -1.0)


def spans(path: Path) -> tuple[list[float], list[float], float]:
    """Return the least and greatest coordinates of a file, and its area to 1e-6."""
    found = corners(path)
    edges = found[:, 1:] - found[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum() / 2.0
    points = found.reshape(-1, 3).round(6) + 0.0
    return points.min(axis=0).tolist(), points.max(axis=0).tolist(), round(float(area), 6)


def refused(path: Path) -> str:
    with pytest.raises(MeshFileError) as error:
        load_mesh_shape(path)
    return str(error.value)


BODY = "<node><instance_controller url='#c'/></node>"
MATERIAL = "<bind_material><technique_common><instance_material symbol='M' target='#none'/>"
SYMBOL = GEOMETRY.replace("<triangles", "<triangles material='M'")


@pytest.mark.parametrize(
    ("nodes", "changed", "said"),
    [
        (f"{HERE}<node name='leg'>{BODY}</node>", {}, "node 'without a name' has a controller"),
        (HERE.replace("#g", "#none"), {}, "node 'arm' refers to the geometry 'none', which does"),
        (HERE.replace("#g", "b.dae#g"), {}, "node 'arm' refers to 'b.dae#g' in another file"),
        (f"{HERE}<node id='k'><instance_node url='#x'/></node>", {}, "node 'k' refers to the node"),
        (f"<node name='tilted'><skew>1 0 0 0 1 0 0</skew>{HERE}</node>", {}, "placed by skew"),
        (f"<node id='l'><lookat>0 0 0 1 0 0 0 0 1</lookat>{HERE}</node>", {}, "placed by lookat"),
        (f"<node id='l'><scale>1 1</scale>{HERE}</node>", {}, "node 'l' has a scale of 2 numbers"),
        (
            HERE.replace(
                "/></node>",
                f">{MATERIAL}</technique_common></bind_material></instance_geometry></node>",
            ),
            {"geometry": SYMBOL},
            "node 'arm' uses the material 'none', which does not exist",
        ),
        (HERE, {"geometry": SYMBOL}, "node 'arm' uses the material 'M', which does not exist"),
        (
            HERE,
            {"geometry": '<geometry id="g" name="hull"><convex_mesh/></geometry>'},
            "geometry 'hull' is not a mesh but convex_mesh",
        ),
        (
            HERE,
            {"geometry": GEOMETRY.replace("0 2 3</p>", "0 2</p>")},
            "geometry 'wall' is cut off: 1 of 2 triangles",
        ),
        (
            HERE,
            {"geometry": GEOMETRY.replace("1 0 0 1 0</float", "1 0</float")},
            "geometry 'wall' is cut off: 9 of 12 numbers",
        ),
        (
            HERE,
            {"geometry": GEOMETRY.replace("0 2 3</p>", "0 2 9</p>")},
            "geometry 'wall' has an index beyond the 4 values",
        ),
        (
            HERE,
            {"geometry": GEOMETRY.replace("<mesh>", '<asset><unit meter="0.01"/></asset><mesh>')},
            "geometry 'g' has its own unit",
        ),
        (
            HERE.replace("<inst", "<asset><up_axis>Y_UP</up_axis></asset><inst"),
            {},
            "node 'n' has its own axis",
        ),
        (
            HERE.replace("<inst", "<matrix>1 0 0 0 0 1 0 0 0 0 1 0 5 0 0 1</matrix><inst"),
            {},
            "node 'arm' has a matrix whose last row is not 0 0 0 1",
        ),
        (HERE, {"scene": ""}, "it has no scene"),
        (HERE, {"scene": SCENE.replace("#s", "#t")}, "its scene 't' does not exist"),
    ],
)
def test_a_part_of_a_collada_file_that_cannot_be_read_is_named(
    tmp_path: Path, nodes: str, changed: dict[str, str], said: str
) -> None:
    assert said in refused(collada(tmp_path, nodes, **changed))


MOVED = "<translate>0 0 2</translate>"
LIBRARY = f"<library_nodes><node id='lib'>{MOVED}<node>{HERE}</node></node></library_nodes>"
OTHER = "</visual_scene><visual_scene id='t'><node><instance_geometry url='#none'/></node>"


@pytest.mark.parametrize(
    ("nodes", "changed", "greatest", "area"),
    [
        (HERE, {}, [1, 1, 0], 1),
        (f"<node>{MOVED}<scale>2 1 1</scale>{HERE}</node>", {}, [2, 1, 2], 2),
        (f"<node><scale>1 1 3</scale>{MOVED}{HERE}</node>", {}, [1, 1, 6], 1),
        (f"<node><rotate>1 0 0 90</rotate>{HERE}</node>", {}, [1, 0, 1], 1),
        (f"<node><matrix>0 0 1 5 0 1 0 0 1 0 0 0 0 0 0 1</matrix>{HERE}</node>", {}, [5, 1, 1], 1),
        (f"{HERE}<node><instance_node url='#lib'/></node>", {"more": LIBRARY}, [1, 1, 2], 2),
        (f"<node><instance_node url='#n'/>{MOVED}</node>{HERE}", {}, [1, 1, 2], 2),
        (HERE + OTHER, {}, [1, 1, 0], 1),
        (f"<node><lookat>9 9 9 1 0 0 0 0 1</lookat></node>{HERE}", {}, [1, 1, 0], 1),
    ],
    ids=[
        *("plain", "moved and scaled", "scaled and moved", "turned", "matrix", "library"),
        *("node of the scene", "another scene", "camera"),
    ],
)
def test_collada_nodes_stand_where_their_scene_has_them(
    tmp_path: Path, nodes: str, changed: dict[str, str], greatest: list[float], area: float
) -> None:
    path = collada(tmp_path, nodes, **changed)
    assert spans(path)[1:] == (greatest, area)


@pytest.mark.parametrize(
    ("faces", "count"),
    [
        (f'<tristrips count="1">{VERTEX}<p>0 1 3 2</p></tristrips>', 2),
        (f'<tristrips count="2">{VERTEX}<p>0 1 3</p><p>1 2 3</p></tristrips>', 2),
        (f'<trifans count="1">{VERTEX}<p>0 1 2 3</p></trifans>', 2),
        (f'<polygons count="1">{VERTEX}<p>0 1 2 3</p></polygons>', 2),
        (f'<polylist count="3">{VERTEX}<vcount>2 3 3</vcount><p>0 1 0 1 2 0 2 3</p></polylist>', 2),
        (f'<lines count="1">{VERTEX}<p>0 1</p></lines>{TRIANGLES}', 2),
        (f'<linestrips count="1">{VERTEX}<p>0 1 2</p></linestrips>{TRIANGLES}', 2),
    ],
)
def test_every_kind_of_collada_faces_is_read(tmp_path: Path, faces: str, count: int) -> None:
    path = collada(tmp_path, geometry=GEOMETRY.replace(TRIANGLES, faces))
    assert len(corners(path)) == count
    assert spans(path) == ([0.0, 0.0, 0.0], [1.0, 1.0, 0.0], 1.0)
    normals = np.cross(*np.moveaxis(np.diff(corners(path), axis=1), 1, 0))
    assert (normals[:, 2] > 0.0).all()


def test_the_unit_and_axes_of_a_collada_file_are_those_of_the_document(tmp_path: Path) -> None:
    """A comment with another unit, which stands before, is none."""
    asset = '<!-- <unit meter="9"/> --><asset><unit meter="0.5"/><up_axis>Z_UP</up_axis></asset>'
    mesh = load_mesh_shape(collada(tmp_path, asset=asset)).mesh
    assert np.abs(mesh.vertices_m).max() == 0.5
    assert np.ptp(mesh.vertices_m[:, 2]) == 0.0


SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"{SQUARE}f 1 2 3\nf 1 3", "a face has 2 corners: it is cut off"),
        (f"{SQUARE}vt 0 0\nf 1/1 2/1 3/1\nf 1/1 3/1 4", "corners of different forms: it is cut"),
        (f"{SQUARE}f 1 2 3\nf 1 3 5\n", "a face refers to vertex 5, which is not one of its 4"),
        (f"{SQUARE}f 0 1 2\n", "a face refers to vertex 0"),
        (f"{SQUARE}f 1 2 3\nsurf 0 1 0 1 1 2 3 4\n", "it has 'surf'"),
        (f"{SQUARE}f 1 2 3\ncall other.obj\n", "it has 'call'"),
        (f"{SQUARE}v 0 0 1 1 0 0\nf 1 2 3\n", "some of its vertices have colours"),
        (f"{SQUARE}v 0 0\nf 1 2 3\n", "damaged"),
        (f"{SQUARE}f 1 2 3\nF 1 3 4\n", "it has the statement 'F', which is unknown"),
        (f"{SQUARE}f 1 2 3\n\0f 1 3 4\n", "it has the statement '\\x00f', which is unknown"),
        (f"{SQUARE}f 1 2 3\n\xa0f 1 3 4\n", "it has the statement '\\xa0f', which is unknown"),
        (f"{SQUARE}f 1 2 3\ng a\\\nf 1 3 4\n", "a line that ends in a backslash goes on in a"),
        (f"{SQUARE}usemtl red\nf 1 2 3\n", "faces use the material 'red', which it has no library"),
    ],
)
def test_an_obj_that_would_lose_something_is_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "a.obj").write_text(text)
    assert said in refused(tmp_path / "a.obj")


@pytest.mark.parametrize(
    "text",
    [
        f"{SQUARE}f 1 2 3 4\n",
        f"{SQUARE}f 1 2 3\nf 1 3 4",
        f"o a\n{SQUARE}g x\ns 1\nf 1 2 3\no b\ng y\nf 1 3 4\n",
        f"{SQUARE}vn 0 0 1\nf 1//1 2//1 3//1\nf 1 3 4\n",
        f"  {SQUARE}\tf\t1\t2  3\t4 # all\n",
        f"{SQUARE}l 1 2\np 1\nf -4 -3 -2 -1\n",
        SQUARE.replace("\n", "\r\n") + "f 1 2 \\\r\n3 4\r\n",
        f"{SQUARE}f 1 2 3 4\n".replace("\n", "\r"),
        SQUARE.replace("v 0 0 0", "v 0 0 0 1.0") + "f 1 2 3 4\n",
        f"{SQUARE}v 5 5 5\nf 1 2 3 4\n",
        f"{SQUARE}f 1 2 3\n# C:\\models\\\nf 1 3 4\n",
        SQUARE.replace("v 1 0 0", "v 1 0 0 # C:\\") + "f 1 2 \\\n3 4 # all\n",
        f"{SQUARE}f 1 2 3\n\ff 1 3 4\n",
    ],
)
def test_an_obj_is_read_however_it_is_written(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.obj").write_bytes(text.encode())
    assert spans(tmp_path / "a.obj") == ([0.0, 0.0, 0.0], [1.0, 1.0, 0.0], 1.0)
    (tmp_path / "b.obj").write_bytes(text.encode("utf-16"))
    assert spans(tmp_path / "b.obj")[2] == 1.0


def exported(path: Path, encoding: str) -> bytes:
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    data = box.export(file_type=path.suffix[1:], **({"encoding": encoding} if encoding else {}))
    return data.encode() if isinstance(data, str) else bytes(data)


@pytest.mark.parametrize(
    ("name", "encoding"), [("a.ply", "ascii"), ("a.ply", "binary"), ("a.stl", "")]
)
def test_a_file_that_is_cut_anywhere_is_refused(tmp_path: Path, name: str, encoding: str) -> None:
    path = tmp_path / name
    data = exported(path, encoding)
    for end in [*range(len(data) // 2, len(data) - 2, 23), len(data) - 2]:
        path.write_bytes(data[:end])
        refused(path)


def solid(name: str, facets: int) -> str:
    facet = "facet normal 0 0 1\nouter loop\n{}endloop\nendfacet\n".format(
        "".join(f"vertex {corner}\n" for corner in ("0 0 0", "1 0 0", "0 1 0"))
    )
    return f"solid {name}\n{facets * facet}endsolid {name}\n"


def test_a_text_stl_has_all_its_solids_or_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.stl"
    whole = solid("one", 2) + solid("two", 3)
    path.write_text(whole)
    assert len(corners(path)) == 5
    for end in range(len(solid("one", 2)) + 8, len(whole) - len(" two\n"), 7):
        path.write_text(whole[:end])
        assert "it is cut off" in refused(path)
    path.write_text(solid("vertex cover", 1))
    assert "cannot be read" in refused(path) or "can be read" in refused(path)


PLY = "ply\nformat ascii 1.0\nelement vertex 4\n{vertex}element face {faces}\n{face}end_header\n"
XYZ = "property float x\nproperty float y\nproperty float z\n"
INDICES = "property list uchar int vertex_indices\n"


def ply(vertices: str, faces: str, *, vertex: str = XYZ, face: str = INDICES) -> str:
    return PLY.format(vertex=vertex, faces=faces.count("\n"), face=face) + vertices + faces


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (ply("0 0 0\n1 0 0\n1 1 0\n0 1 0\n", "3 0 1 2\n3 0 2\n"), "damaged"),
        (ply("0 0 0\n1 0 0\n1 1 0\n0 1 0\n", "3 0 1 2\n2 0 2\n"), "a face has 2 corners"),
        (ply("0 0 0\n1 0 0\n1 1 0\n\n0 1 0\n", "3 0 1 2\n"), "it is cut off: 4 of 5 lines"),
        (
            ply("0 0 0\n1 0 0\n1 1 0\n0 1 0\n", "3 0 1 2\n").replace(
                "end_header", "element tristrips 1\nproperty list int int i\nend_header"
            ),
            "it has elements 'tristrips'",
        ),
        (
            ply("0 0 0\n1 0 0\n1 1 0\n0 1 0\n", "3 0 1 2\n3 0 2 3\n").replace(
                "element face 2\n", f"element face 1\n{INDICES}element face 1\n"
            ),
            "it has elements 'face' twice",
        ),
    ],
)
def test_a_ply_that_would_lose_something_is_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "a.ply").write_text(text)
    assert said in refused(tmp_path / "a.ply")


def test_faces_of_a_ply_keep_their_colours_whatever_their_size(tmp_path: Path) -> None:
    colors = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    faces = "4 0 1 2 3 255 0 0\n3 0 1 2 0 0 255\n"
    path = tmp_path / "a.ply"
    path.write_text(ply("0 0 0\n1 0 0\n1 1 0\n0 1 0\n", faces, face=INDICES + colors))
    mesh = load_mesh_shape(path).mesh
    assert [mesh.materials[k].rgb for k in mesh.face_material] == [(255, 0, 0)] * 2 + [(0, 0, 255)]
