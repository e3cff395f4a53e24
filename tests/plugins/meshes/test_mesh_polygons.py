"""Faces of many corners, and faces that count backwards: read as they are meant, or refused."""

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.plugins.meshes.mesh_polygons import MeshPolygons, check_polygons
from wil_campaign.plugins.meshes.mesh_reader import load_mesh_shape
from wil_campaign.plugins.meshes.mesh_support import UnsupportedMeshError
from wil_campaign.worlds.scene.mesh_formats import MeshFileError

Outline = list[tuple[float, float]]

U: Outline = [(-2, 0), (2, 0), (2, 3), (1, 3), (1, 1), (-1, 1), (-1, 3), (-2, 3)]
ARROW: Outline = [(0, 0), (2, -1), (0.5, 0), (2, 1)]
"""Concave at its third corner: the fan about the first is the arrow, that about the second not."""
HEXAGON: Outline = [(2, 0), (1, 1.7), (-1, 1.7), (-2, 0), (-1, -1.7), (1, -1.7)]
WITH_A_POINT_ON_AN_EDGE: Outline = [(0, 0), (1, 3e-7), (2, 0), (2, 2), (0, 2)]
SQUARE: Outline = [(0, 0), (1, 0), (1, 1), (0, 1)]
TRIANGLE: Outline = [(0, 0), (1, 0), (0, 1)]
STAR: Outline = [(np.cos(2.4 * np.pi * k / 3), np.sin(2.4 * np.pi * k / 3)) for k in range(5)]

CONCAVE = [U, U[::-1], ARROW[1:] + ARROW[:1], STAR]
SOUND = [ARROW, HEXAGON, HEXAGON[::-1], WITH_A_POINT_ON_AN_EDGE, TRIANGLE]
IDS = [*("U", "U turned over", "arrow", "star"), *("arrow", "hexagon", "turned over", "edge", "3")]
CASES = [*((each, False) for each in CONCAVE), *((each, True) for each in SOUND)]

COLLADA = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2026-01-01T00:00:00</created><modified>2026-01-01T00:00:00</modified></asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="{count}">{points}</float_array><technique_common>
<accessor source="#pa" count="{count}" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<source id="n"><float_array id="na" count="3">1 0 0</float_array><technique_common>
<accessor source="#na" count="1" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>{faces}
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="vs"><node id="n"><instance_geometry url="#g"/></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#vs"/></scene></COLLADA>
"""
INPUTS = (
    '<input semantic="NORMAL" source="#n" offset="0"/>'
    '<input semantic="VERTEX" source="#v" offset="1"/>'
)


def write_obj(path: Path, outlines: list[Outline]) -> None:
    lines, first = ["# faces"], 1
    for outline in outlines:
        lines += [f"v 0 {y} {z}" for y, z in outline]
        lines.append("f " + " ".join(f"{first + k}" for k in range(len(outline))))
        first += len(outline)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_ply(path: Path, outlines: list[Outline], *, binary: bool = False) -> None:
    corners = [corner for outline in outlines for corner in outline]
    kind = "binary_little_endian" if binary else "ascii"
    head = (
        f"ply\nformat {kind} 1.0\nelement vertex {len(corners)}\nproperty float x\n"
        f"property float y\nproperty float z\nelement face {len(outlines)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    ).encode()
    body, first = b"", 0
    for y, z in corners:
        body += struct.pack("<3f", 0, y, z) if binary else f"0 {y} {z}\n".encode()
    for outline in outlines:
        size = len(outline)
        face = range(first, first + size)
        text = " ".join(map(str, (size, *face))) + "\n"
        body += struct.pack(f"<B{size}i", size, *face) if binary else text.encode()
        first += size
    path.write_bytes(head + body)


def write_binary_ply(path: Path, outlines: list[Outline]) -> None:
    write_ply(path, outlines, binary=True)


def write_dae(path: Path, outlines: list[Outline], *, polygons: bool = False) -> None:
    points = " ".join(f"0 {y} {z}" for outline in outlines for y, z in outline)
    lists, first = [], 0
    for outline in outlines:
        lists.append(" ".join(f"0 {first + k}" for k in range(len(outline))))
        first += len(outline)
    counts = " ".join(str(len(outline)) for outline in outlines)
    if polygons:
        each = "".join(f"<p>{one}</p>" for one in lists)
        faces = f'<polygons count="{len(outlines)}">{INPUTS}{each}</polygons>'
    else:
        listed = f"<vcount>{counts}</vcount><p>{' '.join(lists)}</p>"
        faces = f'<polylist count="{len(outlines)}">{INPUTS}{listed}</polylist>'
    path.write_text(COLLADA.format(count=3 * first, points=points, faces=faces), encoding="utf-8")


def write_dae_polygons(path: Path, outlines: list[Outline]) -> None:
    write_dae(path, outlines, polygons=True)


WRITERS = {
    "a.obj": write_obj,
    "a.ply": write_ply,
    "b.ply": write_binary_ply,
    "a.dae": write_dae,
    "b.dae": write_dae_polygons,
}


def area(path: Path) -> float:
    mesh = load_mesh_shape(path).mesh
    corners = mesh.vertices_m[mesh.faces]
    edges = corners[:, 1:] - corners[:, :1]
    return float(np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum()) / 2


def area_of(outline: Outline) -> float:
    y, z = np.array(outline).T
    return abs(float(np.dot(y, np.roll(z, -1)) - np.dot(z, np.roll(y, -1)))) / 2


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize(("outline", "is_sound"), CASES, ids=IDS)
def test_a_face_is_its_outline_or_is_refused(
    tmp_path: Path, name: str, outline: Outline, is_sound: bool
) -> None:
    WRITERS[name](tmp_path / name, [outline, outline])
    if is_sound:
        assert area(tmp_path / name) == pytest.approx(2 * area_of(outline), rel=1e-5)
        return
    with pytest.raises(MeshFileError) as error:
        load_mesh_shape(tmp_path / name)
    assert f"a face with {len(outline)} corners is concave" in str(error.value)
    assert "export the mesh with triangulated faces" in str(error.value)


@pytest.mark.parametrize("name", ["a.obj", "a.ply", "a.dae", "b.dae"])
def test_faces_of_different_sizes_are_checked_each(tmp_path: Path, name: str) -> None:
    sound = [TRIANGLE, HEXAGON, ARROW, TRIANGLE]
    WRITERS[name](tmp_path / name, sound)
    assert area(tmp_path / name) == pytest.approx(sum(map(area_of, sound)))
    WRITERS[name](tmp_path / name, [*sound, U])
    with pytest.raises(MeshFileError, match="a face with 8 corners is concave"):
        load_mesh_shape(tmp_path / name)


def test_a_binary_ply_whose_faces_are_taken_apart_wrongly_is_refused(tmp_path: Path) -> None:
    """A face of four corners, one of three and one of five take the room of three of four."""
    write_binary_ply(tmp_path / "a.ply", [SQUARE, TRIANGLE, HEXAGON[:5]])
    with pytest.raises(MeshFileError, match="its faces have different numbers of corners"):
        load_mesh_shape(tmp_path / "a.ply")


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (("<p>0 0 ", "<ph><h>1</h></ph><p>0 0 "), "geometry 'g' has polygons with holes"),
        (("<vcount>4", "<vcount>5"), "geometry 'g' is cut off: .* 4 of 5 corners"),
        (("#p", "#q"), "geometry 'g' has no source 'q'"),
        (('offset="1"', 'offset="one"'), "it is damaged"),
        (("0 3<", "0 99<"), "geometry 'g' has an index beyond the 4 values of its POSITION"),
        (('semantic="POSITION"', 'semantic="PLACE"'), "it is damaged"),
    ],
)
def test_collada_polygons_that_would_be_left_out_are_refused(
    tmp_path: Path, changed: tuple[str, str], said: str
) -> None:
    path = tmp_path / "a.dae"
    write_dae(path, [SQUARE])
    text = path.read_text("utf-8")
    assert changed[0] in text
    path.write_text(text.replace(*changed), encoding="utf-8")
    with pytest.raises(MeshFileError, match=said):
        load_mesh_shape(path)


@given(
    st.lists(st.floats(0, 6.28), min_size=4, max_size=12, unique=True),
    st.integers(0, 11),
    st.tuples(*[st.floats(-3, 3)] * 3),
    st.floats(1e-3, 1e3),
)
def test_no_convex_face_is_refused(
    angles: list[float], first: int, axis: tuple[float, float, float], size_m: float
) -> None:
    """Corners on a circle, whichever comes first, in whichever plane."""
    turned = sorted(angles)[first % len(angles) :] + sorted(angles)[: first % len(angles)]
    across = np.cross(axis, (0.3, 0.5, 0.7))
    up = np.cross(across, axis)
    points = size_m * (np.outer(np.cos(turned), across) + np.outer(np.sin(turned), up))
    check_polygons(MeshPolygons(points, np.arange(len(turned)), np.array([len(turned)])))


@given(st.floats(0.02, 0.98), st.integers(0, 7), st.floats(1e-3, 1e3))
def test_every_opening_is_found_wherever_the_outline_begins(
    width: float, first: int, size_m: float
) -> None:
    y, z = np.array(U[first:] + U[:first]).T
    y = np.where(np.abs(y) == 1.0, y * width, y)
    points = size_m * np.stack([np.zeros(8), y, z], axis=1)
    with pytest.raises(UnsupportedMeshError):
        check_polygons(MeshPolygons(points, np.arange(8), np.array([8])))


TWO = "v 0 0 0\nv 0 1 0\nv 0 0 1\nf {a}\nv 0 5 5\nv 0 6 5\nv 0 5 6\nf {b}\nv 9 9 9\n"


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ("-3 -2 -1", "-3 -2 -1"),
        ("1 2 3", "-3 -2 6"),
        ("-3//-1 -2//-1 -1//-1", "-3//-1 -2//-1 -1//1"),
        ("-3/-2 -2/-2 -1/-1", "-3/1 -2/-1 -1/2"),
        ("1/1/1 2/1/1 -1/-1/-1 # -9", "-3/1/1 -2/1/1 -1/1/1"),
        ("-3 -2 \\\n-1", "4\t5 -1"),
    ],
)
def test_a_face_that_counts_backwards_counts_from_where_it_is(
    tmp_path: Path, a: str, b: str
) -> None:
    path = tmp_path / "two.obj"
    head = "vt 0 0\nvt 1 1\nvn 1 0 0\n"
    path.write_text(head + TWO.format(a=a, b=b), encoding="utf-8")
    mesh = load_mesh_shape(path).mesh
    found = {tuple(sorted(map(tuple, corners))) for corners in mesh.vertices_m[mesh.faces].tolist()}
    near, far = [(0, 0, 0), (0, -1, 0), (0, 0, -1)], [(0, -5, -5), (0, -6, -5), (0, -5, -6)]
    assert found == {tuple(sorted(near)), tuple(sorted(far))}


def test_a_face_that_counts_back_before_the_first_vertex_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "two.obj"
    path.write_text(TWO.format(a="-4 -2 -1", b="-3 -2 -1"), encoding="utf-8")
    said = "a face counts 4 vertices back where only 3 come before it"
    with pytest.raises(MeshFileError, match=said):
        load_mesh_shape(path)
