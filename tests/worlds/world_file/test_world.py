"""World files: what they give, and every fault with its place."""

import math
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from wil_campaign.foundation.files.documents import BadInput, Problem, load_document, parse_document
from wil_campaign.worlds.scene.colors import NAMED, parse_color
from wil_campaign.worlds.scene.motion import StartOnEvent
from wil_campaign.worlds.world_file.world import World

ROOT = Path(__file__).parents[3]
HEAD = """\
schema: wil/world/1
origin: {latitude_deg: 47.4, longitude_deg: 8.5, altitude_m: 488}
objects:
"""
CAGE = "  cage: {shape: {room: {size_north_m: 6, size_east_m: 6, height_m: 2.5}}}\n"
GATE = "{shape: {gate: {inner_size_m: 1}}, pose: {north_m: 3, up_m: 1.2}"

LEG = "{north_m: 1, east_m: 1, up_m: 2, speed_m_s: 1}"


def world(objects: str, folder: Path = Path()) -> World:
    return World.parse(
        parse_document((HEAD + objects).encode(), name="w.yaml", path=folder / "w.yaml")
    )


def faults(objects: str, folder: Path = Path()) -> tuple[Problem, ...]:
    with pytest.raises(BadInput) as caught:
        world(objects, folder)
    return caught.value.problems


def test_the_shipped_gate_world() -> None:
    shipped = World.parse(load_document(ROOT / "worlds" / "gate.yaml"))
    assert shipped.objects == ("cage", "gate")
    assert shipped.frame.latitude_deg == pytest.approx(47.397742)
    gate = shipped.scene("sim", "Wv")["gate"]
    assert gate.pose.position_ned_m == (3.0, 1.1, -1.2)
    assert gate.shape.mesh.materials[0].rgb == NAMED["orange"]
    assert [opening.limit_m for opening in gate.shape.openings] == [0.5]


def test_the_origin_has_its_height_above_the_sea_and_the_geoids_above_the_ellipsoid() -> None:
    text = HEAD.replace("altitude_m: 488", "altitude_m: 488, undulation_m: 47.5") + CAGE
    frame = World.parse(parse_document(text.encode(), name="w.yaml", path=Path("w.yaml"))).frame
    assert (frame.altitude_m, frame.undulation_m) == (488.0, 47.5)
    assert world(CAGE).frame.undulation_m == 0.0


def test_the_shipped_hall_has_every_built_in_thing() -> None:
    hall = World.parse(load_document(ROOT / "worlds" / "hall.yaml"))
    kinds = {each.scene_object.shape.kind for each in hall.placed}
    assert kinds == {"room", "gate", "box", "person", "quadrotor"}
    assert hall.events == {"goal"}


def test_the_worlds_on_the_page_are_worlds(tmp_path: Path) -> None:
    page = ROOT / "docs" / "worlds.md"
    (tmp_path / "models").mkdir()
    tetrahedron(tmp_path / "models" / "shelf.obj")
    blocks = re.findall(r"```yaml\n(.*?)```", page.read_text("utf-8"), re.DOTALL)
    shown = [one for one in blocks if "shape:" in one]
    assert shown
    for block in shown:
        text = block if "schema:" in block else HEAD + block.removeprefix("objects:\n")
        document = parse_document(text.encode(), name="w.yaml", path=tmp_path / "w.yaml")
        assert World.parse(document).objects


def test_where_things_exist_by_default() -> None:
    both = world(CAGE + f"  gate: {GATE}}}\n")
    assert both.scene("sim", "Wv").names == ("cage", "gate")
    assert both.scene("wil", "Wv").names == ("cage", "gate")
    assert both.scene("wil", "W").names == ("cage",)
    assert both.scene("sim", "W").names == ("cage",)
    assert both.scene("real", "W").names == ("cage", "gate")
    assert both.scene("real", "Wv").names == ("cage",)


def test_where_things_exist_when_given() -> None:
    told = world(f"  gate: {GATE}, exists_in: {{sim: both, wil: none, real: Wv}}}}\n")
    assert "gate" in told.scene("sim", "W")
    assert "gate" in told.scene("sim", "Wv")
    assert "gate" not in told.scene("wil", "W")
    assert "gate" not in told.scene("wil", "Wv")
    assert "gate" not in told.scene("real", "W")
    assert "gate" in told.scene("real", "Wv")


def test_ids_are_the_same_in_all_scenes() -> None:
    both = world(f"  a: {GATE}}}\n" + CAGE + f"  b: {GATE}}}\n")
    assert [each.object_id for each in both.scene("sim", "Wv").objects] == [1, 2, 3]
    assert [each.object_id for each in both.scene("sim", "W").objects] == [2]


def test_every_shape_and_colour_form() -> None:
    text = """\
  ring: {shape: {gate: {form: ring, inner_size_m: 0.8, bar_m: 0.05}}, pose: {up_m: 1}, color: red}
  post: {shape: {box: {size_m: [0.2, 0.2, 1.5]}}, pose: {up_m: 0.75}, color: "#102030"}
  who: {shape: person, pose: {north_m: 2, yaw_deg: 90}, color: [1, 2, 3]}
  drone: {shape: {quadrotor: {size_m: 0.4}}, pose: {up_m: 1, roll_deg: 10}}
"""
    scene = world(text).scene("real", "W")
    assert scene["ring"].shape.mesh.materials[0].rgb == NAMED["red"]
    assert scene["post"].shape.mesh.materials[0].rgb == (16, 32, 48)
    assert (1, 2, 3) in [material.rgb for material in scene["who"].shape.mesh.materials]
    assert scene["who"].pose.yaw_rad == pytest.approx(math.pi / 2)


def test_a_motion_starts_at_its_event_and_follows_its_waypoints() -> None:
    text = """\
  who:
    shape: {person: {}}
    pose: {north_m: 2, east_m: -2}
    motion:
      start: {on: goal, delay_s: 1}
      waypoints: [{north_m: 2, east_m: 2, speed_m_s: 1, yaw_deg: 90}]
"""
    walking = world(text)
    assert walking.events == {"goal"}
    who = walking.scene("real", "W")["who"]
    assert who.motion is not None
    assert who.motion.start == StartOnEvent("goal", 1.0)
    assert who.pose_at(13.0, {"goal": 10.0}).position_ned_m == pytest.approx((2.0, 0.0, 0.0))
    assert who.pose_at(13.0).position_ned_m == (2.0, -2.0, 0.0)


def test_a_time_is_counted_from_t0() -> None:
    """The scene's clock runs from long before the vehicles are ready."""
    moving = world(f"  g: {GATE}, motion: {{start: {{at_s: 2}}, waypoints: [{LEG}]}}}}\n")
    gate = moving.scene("sim", "Wv")["g"]
    assert gate.pose_at(1000.0) == gate.pose
    assert gate.pose_at(102.0, {"goal": 100.0}) == gate.pose
    assert gate.pose_at(102.5, {"goal": 100.0}) != gate.pose


MOVING = f"  g: {GATE}, motion: {{waypoints: "
SMALL_ROOM = "{room: {size_north_m: 1, size_east_m: 1, height_m: 1}}"


@pytest.mark.parametrize(
    ("objects", "at", "words", "meant"),
    [
        (
            "  g: {shape: {gate: {inner_size_m: 1}}, pose: {up_m: 0.3}}",
            "0.3}",
            "below the floor",
            "",
        ),
        ("  b: {shape: {box: {size_m: [1, 1, 1]}}}", "b:", "up_m must be at least 0.5", ""),
        (f"  g: {GATE}, color: ornage}}", "ornage", "unknown colour", "orange"),
        (f"  g: {GATE}, color: [1, 2]}}", "[1, 2]", "three numbers", ""),
        (f"  g: {GATE}, color: [1, 2, 256]}}", "[1, 2, 256]", "0 to 255", ""),
        ("  g: {shape: {gate: {inner_size_m: -1}}}", "-1", "at least 0.0001", ""),
        ("  g: {shape: {gate: {inner_sise_m: 1}}}", "inner_sise_m", "", "inner_size_m"),
        ("  g: {shape: {gatte: {}}}", "gatte", "gatte", "gate"),
        ("  g: {shape: {}}", "{}", "exactly one", ""),
        ("  g: {shape: gate}", "gate}", "person or quadrotor", ""),
        ("  g: {shape: persn}", "persn}", "", "person"),
        ("  g: {shape: 3}", "3}", "must be a mapping", ""),
        (f"  g: {GATE}, exists_in: {{sim: Wx}}}}", "Wx", "Wv", "W"),
        (f"  g: {GATE}, texture: none.png}}", "none.png", "texture file", ""),
        ("  m: {shape: {mesh: {file: none.obj}}}", "none.obj", "no such file", ""),
        ("  m: {shape: {mesh: {file: w.txt}}}", "w.txt", "not one of .obj", ""),
        ("  m: {shape: {mesh: {file: a.obj, up: x, forward: -x}}}", "-x", "different axes", ""),
        ("  m: {shape: {mesh: {file: a.obj, up: x}}}", "x}}}", "together", ""),
        (MOVING + f"[{LEG.replace('_s: 1', '_s: 0')}]}}}}", "0}]", "greater than 0", ""),
        (MOVING + f"[{LEG.replace('up_m: 2', 'up_m: 0')}]}}}}", "0, speed", "below the floor", ""),
        (MOVING + "[]}}", "[]", "at least 1", ""),
        (MOVING + f"[{LEG}], start: {{}}}}}}", "{}}}", "at_s", ""),
        (MOVING + f"[{LEG}], start: {{on: gaol}}}}}}", "gaol", "must be takeoff", "goal"),
        (MOVING + f"[{LEG}], start: {{true: goal}}}}}}", "true", "unknown key 'true'", "on"),
        (
            MOVING + f"[{LEG}], start: {{at_s: 1, delay_s: 2}}}}}}",
            "2}}}",
            "counts from an event",
            "",
        ),
        (f"  r: {{shape: {SMALL_ROOM}, color: red}}", "red", "a room has its own textures", ""),
        (f"  r: {{shape: {SMALL_ROOM}, motion: {{waypoints: [{LEG}]}}}}", "{way", "not move", ""),
    ],
)
def test_each_fault_stands_where_it_is(objects: str, at: str, words: str, meant: str) -> None:
    (problem,) = faults(objects + "\n")
    assert words in problem.message
    assert problem.suggestion == meant
    assert (problem.line, problem.column) == (4, objects.index(at) + 1)


def test_all_faults_of_meaning_come_at_once_and_in_order() -> None:
    found = faults(
        "  a: {shape: {gate: {inner_size_m: 1}}, color: ornge}\n"
        "  b: {shape: {person: {}}, pose: {up_m: -1}}\n"
        "  c: {shape: {mesh: {file: none.stl}}}\n"
    )
    assert [problem.line for problem in found] == [4, 4, 5, 6]


def test_a_room_that_is_lower_is_the_floor() -> None:
    room = (
        "  pit: {shape: {room: {size_north_m: 6, size_east_m: 6, height_m: 5}}, pose: {up_m: -2}}\n"
    )
    assert "who" in world(room + "  who: {shape: {person: {}}, pose: {up_m: -2}}\n").objects


def test_more_things_than_ids() -> None:
    person = "{shape: {person: {}}}"
    (problem,) = faults("".join(f"  p{k}: {person}\n" for k in range(255)))
    assert "254" in problem.message


def tetrahedron(path: Path) -> None:
    path.write_text(
        "v 0 0 0\nv 1 0 0\nv 0 2 0\nv 0 0 3\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n", encoding="utf-8"
    )


def test_a_mesh_file_in_its_unit_and_axes(tmp_path: Path) -> None:
    tetrahedron(tmp_path / "t.obj")
    flu = world("  m: {shape: {mesh: {file: t.obj, unit: cm}}}\n", tmp_path)
    mesh = flu.scene("real", "W")["m"].shape.mesh
    np.testing.assert_allclose(mesh.vertices_m.max(axis=0), [0.01, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(mesh.vertices_m.min(axis=0), [0.0, -0.02, -0.03], atol=1e-12)
    text = "  m: {shape: {mesh: {file: t.obj, up: y, forward: z, scale: 2}}, color: blue}\n"
    turned = world(text, tmp_path).scene("real", "W")["m"].shape.mesh
    np.testing.assert_allclose(turned.vertices_m.max(axis=0), [6.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(turned.vertices_m.min(axis=0), [0.0, -2.0, -4.0], atol=1e-12)
    assert turned.materials[0].rgb == NAMED["blue"]
    center = mesh.vertices_m.mean(axis=0)
    corners = mesh.vertices_m[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("ij,ij->i", normals, corners.mean(axis=1) - center) > 0).all()


def test_a_mesh_file_is_read_once_until_it_changes(tmp_path: Path) -> None:
    text = "  m: {shape: {mesh: {file: t.obj}}}\n"
    (tmp_path / "t.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n")
    first, again = (world(text, tmp_path).scene("real", "W")["m"].shape for _ in range(2))
    assert again is first
    (tmp_path / "t.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 22 0\nf 1 2 3\n")
    changed = world(text, tmp_path).scene("real", "W")["m"].shape
    assert np.ptp(changed.mesh.vertices_m, axis=0).tolist() == [1.0, 22.0, 0.0]


def test_a_mesh_is_read_anew_when_a_file_that_it_names_changes(tmp_path: Path) -> None:
    text = "mtllib t.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n"
    (tmp_path / "t.obj").write_text(text)
    reds = []
    for red in ("1", "0.5"):
        (tmp_path / "t.mtl").write_text(f"newmtl a\nKd {red} 0 0\n")
        scene = world("  m: {shape: {mesh: {file: t.obj}}}\n", tmp_path).scene("real", "W")
        reds.append(scene["m"].shape.mesh.materials[0].rgb[0])
    assert reds[0] > reds[1] > 0


def test_a_mesh_in_the_coordinates_of_a_map_is_a_fault(tmp_path: Path) -> None:
    corners = ((500_000, 5_250_000), (500_001, 5_250_000), (500_000, 5_250_002))
    (tmp_path / "t.obj").write_text("".join(f"v {x} {y} 0\n" for x, y in corners) + "f 1 2 3\n")
    (problem,) = faults("  m: {shape: {mesh: {file: t.obj}}}\n", tmp_path)
    assert "5274 km from its own origin" in problem.message
    assert "'unit'" in problem.message
    world("  m: {shape: {mesh: {file: t.obj, unit: mm}}}\n", tmp_path)


@pytest.mark.parametrize("suffix", ["obj", "stl", "glb", "dae"])
@pytest.mark.parametrize("content", [b"", b"\x00\x01garbage\xff", b"solid x\nfacet\nend", b"{}"])
def test_a_mesh_that_cannot_be_read_is_a_fault(tmp_path: Path, suffix: str, content: bytes) -> None:
    (tmp_path / f"bad.{suffix}").write_bytes(content)
    (problem,) = faults(f"  m: {{shape: {{mesh: {{file: bad.{suffix}}}}}}}\n", tmp_path)
    assert f"bad.{suffix}" in problem.message
    assert len(problem.message) < 300


def test_a_transparent_mesh_is_named_unless_the_world_takes_it_for_opaque(
    tmp_path: Path,
) -> None:
    (tmp_path / "t.mtl").write_text("newmtl glass\nKd 0 0 1\nd 0.4\n")
    (tmp_path / "t.obj").write_text(
        "mtllib t.mtl\nv 0 0 0\nv 1 0 0\nv 0 0 1\nusemtl glass\nf 1 2 3\n"
    )
    said = "  m: {{shape: {{mesh: {{file: t.obj{more}}}}}, pose: {{up_m: 1}}}}\n"
    (problem,) = faults(said.format(more=""), tmp_path)
    assert problem.source_line[problem.column - 1 :].startswith("t.obj")
    assert "mesh file 't.obj': material 'glass' is transparent (alpha 0.4)" in problem.message
    taken = world(said.format(more=", transparent: opaque"), tmp_path).scene("real", "W")["m"]
    assert taken.shape.mesh.materials[0].rgb == (0, 0, 255)


@pytest.mark.parametrize("suffix", ["stl", "glb", "dae"])
def test_the_other_mesh_formats(tmp_path: Path, suffix: str) -> None:
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box((2.0, 4.0, 6.0)).export(tmp_path / f"b.{suffix}")
    text = f"  m: {{shape: {{mesh: {{file: b.{suffix}}}}}, pose: {{up_m: 9}}}}\n"
    mesh = world(text, tmp_path).scene("real", "W")["m"].shape.mesh
    size = (2.0, 4.0, 6.0) if suffix == "stl" else (6.0, 2.0, 4.0)
    np.testing.assert_allclose(np.ptp(mesh.vertices_m, axis=0), size, atol=1e-5)


def test_terrain_may_reach_below_the_floor_but_not_be_buried(tmp_path: Path) -> None:
    tetrahedron(tmp_path / "t.obj")
    mesh = "  m: {{shape: {{mesh: {{file: t.obj}}}}, pose: {{up_m: {up}}}}}\n"
    assert world(mesh.format(up=-1), tmp_path).objects == ("m",)
    (problem,) = faults(mesh.format(up=-3.5), tmp_path)
    assert "below the floor" in problem.message


def test_a_texture_from_a_file(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "wood.png"), np.full((30, 70, 3), (10, 20, 30), np.uint8))
    (tmp_path / "text.png").write_text("no picture", encoding="utf-8")
    scene = world(f"  gate: {GATE}, texture: wood.png}}\n", tmp_path).scene("real", "W")
    (material,) = scene["gate"].shape.mesh.materials
    assert material.texture is not None
    assert material.texture.shape == (32, 64, 3)
    assert material.texture[0, 0].tolist() == [10, 20, 30]
    (problem,) = faults(f"  gate: {GATE}, texture: wod.png}}\n", tmp_path)
    assert problem.suggestion == "wood.png"
    (problem,) = faults(f"  gate: {GATE}, texture: text.png}}\n", tmp_path)
    assert "not a PNG, JPEG, BMP" in problem.message
    (problem,) = faults(f"  gate: {GATE}, texture: wood.png, color: red}}\n", tmp_path)
    assert "the texture has its own colours" in problem.message


@pytest.mark.parametrize("above", ["", "parts/", "./parts/../", "{folder}/", "{folder}/parts/"])
def test_a_misspelt_path_is_mended_as_it_was_written(tmp_path: Path, above: str) -> None:
    """Also an absolute one, which is in no folder of the world file."""
    place = tmp_path / "elsewhere"
    (place / "parts").mkdir(parents=True)
    for folder in (place, place / "parts"):
        tetrahedron(folder / "shelf.obj")
        cv2.imwrite(str(folder / "wood.png"), np.zeros((3, 7, 3), np.uint8))
    above = above.format(folder=place)
    (problem,) = faults(f"  m: {{shape: {{mesh: {{file: {above}shelv.obj}}}}}}\n", place)
    assert Path(problem.suggestion) == Path(f"{above}shelf.obj")
    (problem,) = faults(f"  gate: {GATE}, texture: {above}wod.png}}\n", place)
    assert Path(problem.suggestion) == Path(f"{above}wood.png")
    elsewhere = f"  m: {{shape: {{mesh: {{file: {place}/shelv.obj}}}}}}\n"
    assert faults(elsewhere, tmp_path / "none")[0].suggestion == str(place / "shelf.obj")


def test_a_colour_is_read_and_a_wrong_one_is_refused() -> None:
    assert parse_color("#ff8000") == (255, 128, 0)
    for wrong in ("#ff80", "Orange ", [1, 2, 3, 4], [-1, 0, 0]):
        with pytest.raises(ValueError, match="colour"):
            parse_color(wrong)


WALKS = """\
  who:
    shape: person
    motion:
      speed_sd_m_s: 0.2
      acceleration_m_s2: 1
      waypoints: [{north_m: 9, east_m: 0, speed_m_s: 1}]
"""


def test_speeds_are_those_of_the_file_until_the_world_has_a_seed() -> None:
    def speed_m_s(text: str) -> float:
        motion = (
            World.parse(parse_document(text.encode(), name="w", path=Path("w")))
            .placed[0]
            .scene_object.motion
        )
        assert motion is not None
        return motion.waypoints[0].speed_m_s

    assert speed_m_s(HEAD + WALKS) == 1.0
    drawn = [speed_m_s(f"seed: {seed}\n" + HEAD + WALKS) for seed in (1, 2, 1)]
    assert drawn[0] == drawn[2] != drawn[1]
    assert 0.3 < drawn[0] < 1.7


def test_a_walking_person_has_limbs_and_a_standing_one_is_one_body() -> None:
    walking = world(WALKS).scene("sim", "Wv")
    assert len(walking.bodies) == 9
    assert {body.scene_object.name for body in walking.bodies} == {"who"}
    assert len(world("  who: {shape: person}\n").scene("sim", "Wv").bodies) == 1
