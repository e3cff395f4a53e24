"""Built-in things: their sizes, their skins, and that what is drawn is what can be touched."""

import math

import numpy as np
import pytest

from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene import meshes, shapes
from wil_campaign.worlds.scene.meshes import Material, Mesh
from wil_campaign.worlds.scene.parts import BoxShape, HullShape
from wil_campaign.worlds.scene.shapes import Shape

GREY = Material((128, 128, 128))
ALL = {
    "square gate": shapes.gate_shape("square", 1.0, 0.1),
    "ring gate": shapes.gate_shape("ring", 0.6, 0.08),
    "box": shapes.box_shape((0.3, 0.5, 0.9)),
    "quadrotor": shapes.quadrotor_shape(),
    "person": shapes.person_shape(),
    "room": shapes.room_shape(6, 5, 2.5),
    "open room": shapes.room_shape(6, 5, 2.5, ceiling=False),
}
SOLIDS = {
    "box": meshes.box_mesh((1.0, 2.0, 3.0), GREY),
    "ellipsoid": meshes.ellipsoid_mesh((1.0, 2.0, 3.0), GREY),
    "frustum": meshes.frustum_mesh(0.3, 0.5, 2.0, GREY, flatten=0.6),
    "cone": meshes.frustum_mesh(0.6, 0.2, 0.5, GREY),
}


def directed_edges(mesh: Mesh) -> list[tuple[int, int]]:
    _, index = np.unique(np.round(mesh.vertices_m, 7), axis=0, return_inverse=True)
    faces = index.reshape(-1)[mesh.faces]
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return [(int(a), int(b)) for a, b in pairs if a != b]


def outward(mesh: Mesh) -> np.ndarray:
    corners = mesh.vertices_m[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outwards = corners.mean(axis=1) - mesh.vertices_m.mean(axis=0)
    return np.asarray(np.einsum("ij,ij->i", normals, outwards))


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_are_closed_and_wound_outwards(name: str) -> None:
    mesh = SOLIDS[name]
    assert mesh.closed
    assert (outward(mesh) >= -1e-12).all()
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0)


@pytest.mark.parametrize("name", [name for name, shape in ALL.items() if shape.mesh.closed])
def test_closed_things_have_each_edge_in_both_directions(name: str) -> None:
    edges = directed_edges(ALL[name].mesh)
    assert sorted(edges) == sorted((b, a) for a, b in edges)


def part_corners(shape: Shape) -> np.ndarray:
    corners = []
    for part in shape.parts:
        if isinstance(part.shape, HullShape):
            local = part.shape.vertices_m
        else:
            assert isinstance(part.shape, BoxShape)
            signs = [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
            local = np.array(signs) * np.array(part.shape.half_m)
        corners += [part.pose.to_parent(tuple(corner)) for corner in local.tolist()]
    return np.array(corners)


@pytest.mark.parametrize("name", ["square gate", "ring gate", "box", "quadrotor", "person"])
def test_the_drawn_shape_is_the_shape_that_can_be_touched(name: str) -> None:
    shape = ALL[name]
    drawn = np.unique(np.round(shape.mesh.vertices_m, 6), axis=0)
    touched = np.unique(np.round(part_corners(shape), 6), axis=0)
    np.testing.assert_allclose(touched, drawn, atol=2e-6)
    assert np.linalg.norm(touched, axis=1).max() <= shape.radius_m + 1e-6


@pytest.mark.parametrize("name", ["ring gate", "quadrotor", "person"])
def test_every_touchable_piece_is_convex_and_wound_outwards(name: str) -> None:
    for part in ALL[name].parts:
        assert isinstance(part.shape, HullShape)
        points, faces = part.shape.vertices_m, part.shape.faces
        corners = points[faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        above = np.einsum("fj,fpj->fp", normals, points[None] - corners[:, :1])
        assert above.max() < 1e-9, part.name


def test_a_square_gate_has_its_size() -> None:
    mesh = ALL["square gate"].mesh
    np.testing.assert_allclose(mesh.vertices_m.max(axis=0), [0.05, 0.6, 0.6])
    free = np.abs(mesh.vertices_m[:, 1:]).max(axis=1)
    assert free.min() == pytest.approx(0.5)
    (opening,) = ALL["square gate"].openings
    assert (opening.form, opening.limit_m) == ("square", 0.5)


def test_a_ring_leaves_its_inner_circle_free() -> None:
    mesh = ALL["ring gate"].mesh
    corners = mesh.vertices_m[mesh.faces][:, :, 1:]
    middles = (corners + np.roll(corners, 1, axis=1)) / 2.0
    nearest = min(
        np.hypot(*corners.reshape(-1, 2).T).min(), np.hypot(*middles.reshape(-1, 2).T).min()
    )
    assert nearest == pytest.approx(0.3, abs=1e-6)
    assert ALL["ring gate"].openings[0].limit_m == pytest.approx(0.3)


def test_a_person_stands_on_the_ground_and_is_175_cm_tall() -> None:
    mesh = ALL["person"].mesh
    assert mesh.vertices_m[:, 2].max() == pytest.approx(0.0, abs=1e-9)
    assert -mesh.vertices_m[:, 2].min() == pytest.approx(1.75, abs=1e-3)


def test_a_quadrotor_is_as_wide_as_asked() -> None:
    vertices = shapes.quadrotor_shape(0.4).mesh.vertices_m
    assert np.ptp(vertices[:, 1]) == pytest.approx(0.4, abs=5e-3)


def test_a_room_is_free_inside_and_its_skin_looks_inwards() -> None:
    room = ALL["room"]
    assert not room.mesh.closed
    assert (outward(room.mesh) < 0.0).all()
    assert [part.name for part in room.parts if part.is_floor] == ["floor"]
    assert len(room.parts) == 6
    assert "ceiling" not in [part.name for part in ALL["open room"].parts]
    low, high = room.mesh.vertices_m.min(axis=0), room.mesh.vertices_m.max(axis=0)
    np.testing.assert_allclose(low, [-3, -2.5, -2.5])
    np.testing.assert_allclose(high, [3, 2.5, 0])


def test_room_textures_are_structured_muted_and_seeded() -> None:
    rooms = [shapes.room_shape(6, 6, 2.5, seed=seed).mesh for seed in (0, 0, 1)]
    first, again, other = (
        [m.texture for m in room.materials if m.texture is not None] for room in rooms
    )
    assert len(first) == 6
    for a, b, c in zip(first, again, other, strict=True):
        np.testing.assert_array_equal(a, b)
        assert (a != c).any()
        wide = a.astype(float)
        assert wide.std(axis=(0, 1)).min() > 4.0
        saturation = np.ptp(wide, axis=2) / wide.max(axis=2)
        assert saturation.max() < 0.35


def test_painting_and_moving_leave_the_original_alone() -> None:
    mesh = meshes.box_mesh((1.0, 1.0, 1.0), GREY)
    moved = mesh.painted((1, 2, 3)).moved(Pose.of(5, 0, 0, yaw_rad=math.pi / 2))
    assert mesh.materials[0].rgb == (128, 128, 128)
    assert moved.materials[0].rgb == (1, 2, 3)
    assert mesh.vertices_m[:, 0].max() == pytest.approx(0.5)
    assert moved.vertices_m[:, 0].max() == pytest.approx(5.5)
    np.testing.assert_allclose(moved.normals[0], [0, 1, 0], atol=1e-12)
