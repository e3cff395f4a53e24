"""The renderer against an independent ray caster, and what it promises about bits and threads."""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose, matrix_from_quat
from wil_campaign.worlds.rays.raycast import SceneRayCaster
from wil_campaign.worlds.render.placing import NEAR_M
from wil_campaign.worlds.render.renderer import Renderer, RenderOutput
from wil_campaign.worlds.scene import meshes, shapes
from wil_campaign.worlds.scene.motion import ObjectMotion, StartOnEvent, Waypoint
from wil_campaign.worlds.scene.scene import Scene, SceneObject
from wil_campaign.worlds.scene.shapes import Shape

VGA = Intrinsics.from_fov(320, 240, math.radians(69))
SKEWED = Intrinsics(200, 150, 140.0, 180.0, 61.5, 90.25)


def cage_scene() -> Scene:
    return Scene(
        (
            SceneObject(7, "cage", shapes.room_shape(6, 6, 2.5), Pose.of(1.5, 0, 0)),
            SceneObject(2, "gate", shapes.gate_shape("square", 1.0, 0.1), Pose.of(3, 0, 1.2)),
            SceneObject(
                9, "ring", shapes.gate_shape("ring", 0.6, 0.08), Pose.of(3.5, -1, 1.4, yaw_rad=0.7)
            ),
            SceneObject(200, "person", shapes.person_shape(), Pose.of(2.6, 1.1, 0, yaw_rad=2.5)),
            SceneObject(
                5,
                "drone",
                shapes.quadrotor_shape(),
                Pose.of(1.5, -0.6, 1.5, roll_rad=0.2, yaw_rad=0.4),
            ),
        )
    )


POSES = [
    Pose.of(0, 0, 1.2),
    Pose.of(0.3, -0.4, 1.0, roll_rad=0.3, pitch_rad=-0.2, yaw_rad=0.2),
    Pose.of(2.7, 0.2, 1.3, roll_rad=-0.4, pitch_rad=0.3, yaw_rad=-0.3),
    Pose.of(4.3, -2.0, 2.2, pitch_rad=-0.6, yaw_rad=2.4),
    Pose.of(1.4, -0.4, 1.52, yaw_rad=-1.0),
]


def cast_picture(scene: Scene, pose: Pose, camera: Intrinsics) -> tuple[np.ndarray, np.ndarray]:
    """Depth and ids by one ray through each pixel's centre."""
    columns, rows = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    across = (columns - camera.cx_px) / camera.fx_px
    down = (rows - camera.cy_px) / camera.fy_px
    rays = np.stack([np.ones_like(across), across, down], axis=-1).reshape(-1, 3)
    lengths = np.linalg.norm(rays, axis=1)
    directions = (rays / lengths[:, None]) @ matrix_from_quat(pose.q_wxyz).T
    hits = SceneRayCaster(scene).cast(pose.position_ned_m, directions, 0.0)
    return (hits.ranges_m / lengths).reshape(rows.shape), hits.object_ids.reshape(rows.shape)


def rim(scene: Scene, pose: Pose, camera: Intrinsics, pixels: np.ndarray) -> np.ndarray:
    """(n, 8) ids that rays meet which pass pixels within the rounding of corners, 1/256 pixel."""
    turns = np.arange(8) * math.pi / 4
    columns = pixels[:, 1:] + 1.5 / 256 * np.cos(turns)
    rows = pixels[:, :1] + 1.5 / 256 * np.sin(turns)
    across = (columns - camera.cx_px) / camera.fx_px
    down = (rows - camera.cy_px) / camera.fy_px
    rays = np.stack([np.ones_like(across), across, down], axis=-1).reshape(-1, 3)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    rays = rays @ matrix_from_quat(pose.q_wxyz).T
    return SceneRayCaster(scene).cast(pose.position_ned_m, rays, 0.0).object_ids.reshape(-1, 8)


def away_from_edges(ids: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Pixels whose neighbours show the same thing on the same plane: 1/z is linear there."""
    inverse, middle = 1.0 / depth, (slice(1, -1), slice(1, -1))
    same = np.ones(inverse[middle].shape, bool)
    for row, column in ((0, 1), (1, 0), (1, 1), (1, -1)):
        before, after = (
            (
                slice(1 + sign * row, sign * row - 1 or None),
                slice(1 + sign * column, sign * column - 1 or None),
            )
            for sign in (-1, 1)
        )
        same &= (ids[before] == ids[middle]) & (ids[after] == ids[middle])
        bend = inverse[before] + inverse[after] - 2.0 * inverse[middle]
        same &= np.abs(bend) <= 1e-5 * inverse[middle]
    inner = np.zeros(ids.shape, bool)
    inner[middle] = same
    return inner


@pytest.mark.parametrize("camera", [VGA, SKEWED], ids=["fov69", "skewed"])
@pytest.mark.parametrize("pose", POSES)
def test_agrees_with_the_ray_caster(pose: Pose, camera: Intrinsics) -> None:
    scene = cage_scene()
    picture = Renderer(scene).render(pose, camera, 0.0)
    depth, ids = cast_picture(scene, pose, camera)
    assert picture.depth_m is not None
    assert picture.object_ids is not None
    assert np.mean(picture.object_ids != ids) < 0.005
    other = np.argwhere((picture.object_ids != ids) & (depth > 0.06))
    seen_near = rim(scene, pose, camera, other)
    drawn = picture.object_ids[other[:, 0], other[:, 1]]
    assert (seen_near == drawn[:, None]).any(axis=1).all(), "a pixel shows what is not there"
    inner = away_from_edges(ids, depth) & (depth > 0.06)
    assert inner.mean() > 0.5
    assert np.mean(picture.object_ids[inner] == ids[inner]) >= 0.9999
    seen = inner & (picture.object_ids == ids) & (ids > 0)
    assert np.abs(picture.depth_m[seen] - depth[seen]).max() < 1e-3


def test_a_point_is_drawn_where_the_camera_projects_it() -> None:
    """Pixel centres are integers: a small ball shows at the pixel that `project` says."""
    ball = meshes.ellipsoid_mesh((0.03, 0.03, 0.03), meshes.Material((255, 0, 0)))
    scene = Scene((SceneObject(1, "ball", Shape("ball", ball, ()), Pose.of(3.0, 0.4, -0.3)),))
    picture = Renderer(scene).render(Pose.of(0, 0, 0), VGA, 0.0)
    assert picture.object_ids is not None
    rows, columns = np.nonzero(picture.object_ids)
    projected = VGA.project((3.0, 0.4, 0.3))
    assert projected is not None
    assert (columns.mean(), rows.mean()) == pytest.approx(projected, abs=0.51)


def test_a_square_covers_exactly_the_pixels_whose_centres_are_inside() -> None:
    side = meshes.quad_mesh((1.0, 0.0, 0.0), (0, 0.1, 0), (0, 0, -0.1), meshes.Material((9, 9, 9)))
    scene = Scene((SceneObject(1, "side", Shape("side", side, ()), Pose((0.0, 0.0, 0.0))),))
    camera = Intrinsics(64, 64, 100.0, 100.0, 31.5, 31.5)
    ids = Renderer(scene).render(Pose((0.0, 0.0, 0.0)), camera, 0.0).object_ids
    assert ids is not None
    expected = np.zeros((64, 64), np.uint8)
    expected[22:42, 22:42] = 1
    np.testing.assert_array_equal(ids, expected)


def test_neighbours_share_no_pixel_and_leave_none_out() -> None:
    """A wall of many slivers hides what is behind it everywhere, at every subpixel offset."""
    rng = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(np.linspace(-2, 2, 40), np.linspace(-2, 2, 30)), -1)
    grid[1:-1, 1:-1] += rng.uniform(-0.04, 0.04, grid[1:-1, 1:-1].shape)
    vertices = np.concatenate([np.full((*grid.shape[:2], 1), 1.0), grid], -1).reshape(-1, 3)
    index = np.arange(1200).reshape(30, 40)
    a, b = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    c, d = index[1:, 1:].ravel(), index[1:, :-1].ravel()
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])
    wall = meshes.mesh_from_triangles(vertices, faces, meshes.Material((50, 50, 50)))
    scene = Scene((SceneObject(1, "wall", Shape("wall", wall, ()), Pose((0.0, 0.0, 0.0))),))
    ids = Renderer(scene).render(Pose.of(0.003, 0.001, 0.002), VGA, 0.0).object_ids
    assert ids is not None
    assert (ids == 1).all()


def test_a_triangle_that_reaches_far_behind_and_beside_the_camera_is_clipped_right() -> None:
    corners = np.array([[-3000.0, -5000.0, 1.0], [9000.0, -4000.0, 1.0], [2000.0, 9000.0, 1.0]])
    ground = meshes.mesh_from_triangles(
        corners, np.array([[0, 1, 2]]), meshes.Material((90, 90, 90))
    )
    scene = Scene((SceneObject(3, "ground", Shape("ground", ground, ()), Pose((0.0, 0.0, 0.0))),))
    pose = Pose.of(0, 0, 0, pitch_rad=-0.3)
    picture = Renderer(scene).render(pose, VGA, 0.0)
    depth, ids = cast_picture(scene, pose, VGA)
    assert picture.object_ids is not None
    assert picture.depth_m is not None
    inner = away_from_edges(ids, depth)
    np.testing.assert_array_equal(picture.object_ids[inner], ids[inner])
    near = inner & (ids > 0) & (depth < 30)
    assert near.sum() > 10_000
    assert np.abs(picture.depth_m[near] - depth[near]).max() < 1e-3


def assert_same(a: RenderOutput, b: RenderOutput) -> None:
    np.testing.assert_array_equal(a.image_bgr, b.image_bgr)
    np.testing.assert_array_equal(a.depth_m, b.depth_m)
    np.testing.assert_array_equal(a.object_ids, b.object_ids)


def test_threads_and_repeats_give_equal_bits() -> None:
    renderer = Renderer(cage_scene())
    single = [renderer.render(pose, VGA, 0.0) for pose in POSES]
    with ThreadPoolExecutor(4) as pool:
        many = list(pool.map(lambda i: renderer.render(POSES[i % 5], VGA, 0.0), range(60)))
    for i, picture in enumerate(many):
        assert_same(picture, single[i % 5])
    assert_same(Renderer(cage_scene()).render(POSES[1], VGA, 0.0), single[1])


def test_outputs_that_are_not_wanted_are_none_and_change_nothing() -> None:
    renderer = Renderer(cage_scene())
    full = renderer.render(POSES[0], VGA, 0.0)
    bare = renderer.render(POSES[0], VGA, 0.0, want_depth=False, want_ids=False)
    assert bare.depth_m is None
    assert bare.object_ids is None
    np.testing.assert_array_equal(full.image_bgr, bare.image_bgr)


def test_only_makes_all_else_absent() -> None:
    picture = Renderer(cage_scene()).render(POSES[0], VGA, 0.0, only=frozenset({"gate"}))
    assert picture.object_ids is not None
    assert picture.depth_m is not None
    assert set(np.unique(picture.object_ids)) == {0, 2}
    assert np.isinf(picture.depth_m[picture.object_ids == 0]).all()


def test_a_moving_thing_is_drawn_where_it_is() -> None:
    way = ObjectMotion(Pose.of(3, -1, 0), (Waypoint((3.0, 1.0, 0.0), 1.0),), StartOnEvent("go"))
    scene = Scene((SceneObject(1, "box", shapes.box_shape((0.2, 0.2, 0.2)), way.begin, way),))
    renderer = Renderer(scene)

    def column(t_s: float, events: dict[str, float]) -> float:
        ids = renderer.render(Pose.of(0, 0, 0), VGA, t_s, events).object_ids
        assert ids is not None
        return float(np.nonzero(ids)[1].mean())

    waiting = column(9.0, {})
    assert waiting == column(5.0, {"go": 5.0})
    assert column(6.0, {"go": 5.0}) == pytest.approx(VGA.cx_px, abs=0.6)
    assert column(7.0, {"go": 5.0}) == pytest.approx(2 * VGA.cx_px - waiting, abs=1.0)


def test_an_empty_scene_is_sky_over_ground() -> None:
    picture = Renderer(Scene()).render(Pose.of(0, 0, 1), VGA, 0.0)
    assert picture.object_ids is not None
    assert not picture.object_ids.any()
    sky, ground = picture.image_bgr[10, 160], picture.image_bgr[-10, 160]
    assert sky[0] > sky[2]
    assert int(sky.sum()) > int(ground.sum())


def test_both_sides_of_a_face_are_lit_alike() -> None:
    """A sheet seen from its back is lit as one that faces the viewer."""
    paint = meshes.Material((200, 200, 200))
    front = meshes.quad_mesh((1.0, 0.0, 0.0), (0, 1.0, 0), (0, 0, -1.0), paint)
    back = meshes.quad_mesh((1.0, 0.0, 0.0), (0, -1.0, 0), (0, 0, -1.0), paint)
    pixels = []
    for mesh in (front, back):
        scene = Scene((SceneObject(1, "sheet", Shape("sheet", mesh, ()), Pose((0.0, 0.0, 0.0))),))
        picture = Renderer(scene).render(Pose((0.0, 0.0, 0.0)), VGA, 0.0)
        pixels.append(picture.image_bgr[120, 160].tolist())
    assert pixels[0] == pixels[1]


AMBIENT, LAMP, SKY = 0.62, 0.34, 0.08
TO_LAMP = np.array([-0.5, 0.3, -0.81])


@pytest.mark.parametrize("turn", [0.0, 0.4, 1.1, 2.0, -2.6])
def test_a_flat_face_has_the_colour_that_the_light_gives_it(turn: float) -> None:
    """Ambient, Lambert and sky by formula, for each face of a turned box that is seen."""
    place = Pose.of(2.0, 0.0, 0.0, roll_rad=0.5 * turn, pitch_rad=0.3, yaw_rad=turn)
    thing = SceneObject(1, "box", shapes.box_shape((0.6, 0.6, 0.6), (250, 120, 40)), place)
    scene, rotation = Scene((thing,)), matrix_from_quat(place.q_wxyz)
    picture = Renderer(scene).render(Pose.of(0, 0, 0), VGA, 0.0)
    depth, ids = cast_picture(scene, Pose.of(0, 0, 0), VGA)
    lamp = TO_LAMP / np.linalg.norm(TO_LAMP)
    rows, columns = np.nonzero(away_from_edges(ids, depth) & (ids == 1))
    assert len(rows) > 1000
    for row, column in list(zip(rows.tolist(), columns.tolist(), strict=True))[::37]:
        z = depth[row, column]
        right, down = (column - VGA.cx_px) / VGA.fx_px, (row - VGA.cy_px) / VGA.fy_px
        own = np.array(place.to_local((z, z * right, z * down)))
        axis = int(np.abs(own).argmax())
        normal = rotation[:, axis] * np.sign(own[axis])
        light = AMBIENT + LAMP * max(0.0, float(normal @ lamp)) + SKY * -normal[2]
        expected = np.array([40, 120, 250]) * min(1.0, light)
        assert np.abs(picture.image_bgr[row, column] - expected).max() <= 1.5


def test_a_camera_inside_of_a_closed_thing_sees_it_from_inside() -> None:
    thing = SceneObject(4, "box", shapes.box_shape((1.0, 2.0, 3.0)), Pose.of(0, 0, 0, yaw_rad=0.3))
    scene, inside = Scene((thing,)), Pose.of(0.1, 0.2, 0.3, roll_rad=0.2, yaw_rad=1.0)
    picture = Renderer(scene).render(inside, VGA, 0.0)
    depth, _ = cast_picture(scene, inside, VGA)
    assert picture.object_ids is not None
    assert picture.depth_m is not None
    assert (picture.object_ids == 4).all()
    np.testing.assert_allclose(picture.depth_m, depth, atol=1e-4)


@pytest.mark.parametrize("gap_m", [0.5, 0.051, 0.049, 0.0, -0.3])
def test_before_and_behind_the_near_plane(gap_m: float) -> None:
    """What is nearer than 5 cm is cut away, what is behind never shows; nothing is mirrored."""
    wall = meshes.quad_mesh((gap_m, 0, 0), (0, 5.0, 0), (0, 0, -5.0), meshes.Material((9, 9, 9)))
    far = meshes.quad_mesh((4.0, 0, 0), (0, 50.0, 0), (0, 0, -50.0), meshes.Material((9, 9, 9)))
    scene = Scene(
        (
            SceneObject(1, "wall", Shape("wall", wall, ()), Pose((0.0, 0.0, 0.0))),
            SceneObject(2, "far", Shape("far", far, ()), Pose((0.0, 0.0, 0.0))),
        )
    )
    ids = Renderer(scene).render(Pose.of(0, 0, 0), VGA, 0.0).object_ids
    assert ids is not None
    assert np.unique(ids).tolist() == [1 if gap_m > NEAR_M else 2]


@pytest.mark.parametrize("at", [(2.3, 3.0), (2.3, 3.3), (-2.9, -2.9)])
def test_a_closed_room_has_no_cracks(at: tuple[float, float]) -> None:
    """Its sides share corners: from anywhere inside, no background shows between them."""
    scene = Scene((SceneObject(1, "room", shapes.room_shape(6.1, 7.3, 2.45), Pose.of(0, 0, 0)),))
    renderer = Renderer(scene)
    for k in range(12):
        pose = Pose.of(*at, 0.4 + 0.17 * k, roll_rad=0.1 * k, pitch_rad=0.2 * k - 1, yaw_rad=k)
        ids = renderer.render(pose, VGA, 0.0).object_ids
        assert ids is not None
        assert ids.all()


def test_a_texture_is_upright_and_repeats() -> None:
    texture = np.zeros((4, 4, 3), np.uint8)
    texture[0, 0] = (0, 0, 250)
    side = meshes.quad_mesh(
        (1.0, 0.0, 0.0),
        (0, 0.2, 0),
        (0, 0, -0.2),
        meshes.Material((255, 255, 255), texture),
        (2.0, 2.0),
    )
    scene = Scene((SceneObject(1, "side", Shape("side", side, ()), Pose((0.0, 0.0, 0.0))),))
    camera = Intrinsics(64, 64, 100.0, 100.0, 31.5, 31.5)
    red = Renderer(scene).render(Pose((0.0, 0.0, 0.0)), camera, 0.0).image_bgr[12:52, 12:52, 2] > 90
    expected = np.zeros((40, 40), bool)
    for row in (0, 20):
        for column in (0, 20):
            expected[row : row + 5, column : column + 5] = True
    np.testing.assert_array_equal(red, expected)


def test_a_texture_of_odd_size_is_refused() -> None:
    texture = np.zeros((3, 5, 3), np.uint8)
    side = meshes.box_mesh((1.0, 1.0, 1.0), meshes.Material((255, 255, 255), texture))
    with pytest.raises(ValueError, match="powers of two"):
        Renderer(Scene((SceneObject(1, "x", Shape("x", side, ()), Pose((0.0, 0.0, 0.0))),)))
