"""Openings of meshes: outlines and polygons, where they are, and what is none."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.worlds.world_file.test_world import faults, world
from wil_campaign.safety.oracles.gates import gates_of
from wil_campaign.worlds.frames import Pose, Vec3, rotate
from wil_campaign.worlds.scene import shapes
from wil_campaign.worlds.scene.mesh_openings import (
    OpeningError,
    outline_opening,
    polygon_opening,
)
from wil_campaign.worlds.scene.parts import ObjectOpening
from wil_campaign.worlds.scene.scene import Scene

FORWARD = (1.0, 0.0, 0.0)
AT = """
  window:
    shape: {mesh: {file: frame.obj, opening: OPENING}}
    pose: {north_m: 4, up_m: 1.5, yaw_deg: 90}
"""


def margin_m(opening: ObjectOpening, point_m: Vec3) -> float:
    """The distance to the edge of where a flight straight through a point crosses."""
    start, end = (tuple(np.add(point_m, rotate(opening.pose.q_wxyz, (x, 0, 0)))) for x in (-9, 9))
    crossing = opening.crossing(start, end)
    assert crossing is not None
    assert crossing.direction == 1
    return opening.limit_m - crossing.offset_m


@pytest.mark.parametrize("form", ["square", "ring"])
def test_the_outline_of_a_gate_s_mesh_is_the_gate_s_own_opening(form: Any) -> None:
    built = shapes.gate_shape(form, 1.2, 0.1)
    found = outline_opening(built.mesh, (0.01, 0.2, -0.1), FORWARD)
    (own,) = built.openings
    assert found.limit_m == pytest.approx(own.limit_m, abs=0.01)
    assert np.linalg.norm(found.pose.position_ned_m) < 0.02
    for right, down in ((0.0, 0.0), (0.35, 0.1), (-0.4, 0.38), (0.7, 0.0), (-0.1, -0.9)):
        wanted = own.limit_m - own.offset_m((0.0, right, down))
        if form == "square" and wanted < 0.0 and abs(right) > 0.6 < abs(down):
            continue
        assert margin_m(found, (0.0, right, down)) == pytest.approx(wanted, abs=0.02)


def test_a_polygon_of_any_attitude_is_flown_through_along_its_way() -> None:
    """A slanted trapezoid, its corners in either order."""
    tilt = Pose.of(0.3, -0.2, 0.5, pitch_rad=math.radians(20.0), yaw_rad=math.radians(15.0))
    flat = [(-0.5, 1.0), (0.5, 1.0), (0.3, -1.0), (-0.3, -1.0)]
    corners = np.array([tilt.to_parent((0.0, right, down)) for right, down in flat])
    for order in (corners, corners[::-1]):
        found = polygon_opening(order, FORWARD)
        assert rotate(found.pose.q_wxyz, FORWARD)[0] > 0.8
        # The largest circle touches both slanted sides, as deep as the opening is wide.
        assert margin_m(found, tilt.to_parent((0.0, 0.0, 0.9))) == pytest.approx(0.1, abs=1e-3)
        assert margin_m(found, tilt.to_parent((0.0, 0.6, 1.0))) == pytest.approx(-0.1, abs=2e-3)
        assert found.limit_m == pytest.approx(0.44, abs=0.02)


@pytest.mark.parametrize(
    ("corners", "said"),
    [
        (((0, 0, 0), (0, 1, 0), (0, 2, 0)), "on a line"),
        (((0, 0, 0), (0, 1, 0), (0.3, 1, 1), (0, 0, 1)), "m off a plane"),
        (((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)), "along the way through"),
        (((0, 0, 0), (0, 1, 1), (0, 1, 0), (0, 0, 1)), "crosses itself"),
    ],
)
def test_corners_that_are_no_opening(corners: Any, said: str) -> None:
    with pytest.raises(OpeningError, match=said):
        polygon_opening(np.array(corners, np.float64), FORWARD)


def test_a_point_with_nothing_round_it() -> None:
    mesh = shapes.gate_shape("square", 1.0, 0.1).mesh
    for at in ((0.5, 0.0, 0.0), (0.0, 3.0, 0.0)):
        with pytest.raises(OpeningError, match="no closed outline round this point"):
            outline_opening(mesh, at, FORWARD)


@pytest.mark.parametrize(("form", "at"), [("square", 0.65), ("ring", 0.65)])
def test_a_point_in_the_material_is_no_opening(form: Any, at: float) -> None:
    """The outer outline of a wall is round it, too: a flight into the wall passed through that."""
    mesh = shapes.gate_shape(form, 1.2, 0.1).mesh
    with pytest.raises(OpeningError, match="in the material of the mesh"):
        outline_opening(mesh, (0.01, at, 0.01), FORWARD)
    corners = np.array(
        [(0.0, at + right, down) for right, down in ((-0.02, 0), (0.02, 0), (0, 0.1))]
    )
    with pytest.raises(OpeningError, match="in the material of the mesh"):
        polygon_opening(corners, FORWARD, mesh)
    assert polygon_opening(corners - (0.0, at, 0.0), FORWARD, mesh).limit_m > 0.0


def write_frame(path: Path) -> None:
    """A square frame of four bars around a hole of 1 m, 0.5 m over the origin of the file."""
    mesh = shapes.gate_shape("square", 1.0, 0.2).mesh
    lines = [f"v {x:.6f} {-y:.6f} {0.5 - z:.6f}" for x, y, z in mesh.vertices_m.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces.tolist()]
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize(
    "opening",
    [
        "{at_m: [0, 0.1, 0.4]}",
        "{polygon_m: [[0, -0.5, 0], [0, 0.5, 0], [0, 0.5, 1], [0, -0.5, 1]]}",
    ],
)
def test_a_mesh_of_a_world_file_is_a_gate(tmp_path: Path, opening: str) -> None:
    write_frame(tmp_path / "frame.obj")
    scene: Scene = world(AT.replace("OPENING", opening), tmp_path).scene("sim", "Wv")
    gate = gates_of(scene)["window"]
    assert gate.limit_m == pytest.approx(0.5, abs=0.01)
    # It faces east, its middle 2 m up.
    crossing = gate.crossing((4.2, -1.0, -2.1), 0.0, (4.2, 1.0, -2.1), 1.0, {})
    assert crossing is not None
    assert crossing.direction == 1
    assert crossing.fraction == pytest.approx(0.5)
    assert gate.limit_m - crossing.offset_m == pytest.approx(0.3, abs=0.01)


@pytest.mark.parametrize(
    ("opening", "said"),
    [
        ("{at_m: [0, 5, 0.5]}", "no closed outline round this point"),
        ("{polygon_m: [[0, 0, 0], [0, 1, 0], [0, 2, 0]]}", "the corners are on a line"),
        ("{at_m: [0, 0, 0], polygon_m: [[0, 0, 0], [0, 1, 0], [0, 0, 1]]}", "exactly one of"),
        ("{}", "exactly one of"),
    ],
)
def test_an_opening_that_is_none_is_a_fault_at_its_place(
    tmp_path: Path, opening: str, said: str
) -> None:
    write_frame(tmp_path / "frame.obj")
    (fault,) = faults(AT.replace("OPENING", opening), tmp_path)
    assert said in fault.headline
    assert fault.line > 2
