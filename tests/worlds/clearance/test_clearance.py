"""Swept clearance against dense sampling with other means of measuring."""

import math

import fcl
import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from wil_campaign.worlds.clearance.clearance import (
    BoxShape,
    Clearance,
    ClearanceProbe,
    SphereShape,
)
from wil_campaign.worlds.clearance.distance import BodySolid, PartGap, PartSolid
from wil_campaign.worlds.frames import Pose, Vec3, angle_between, matrix_from_quat, quat_normalize
from wil_campaign.worlds.scene import shapes
from wil_campaign.worlds.scene.motion import ObjectMotion, StartAtTime, Waypoint
from wil_campaign.worlds.scene.parts import SolidPart, SurfaceShape
from wil_campaign.worlds.scene.scene import Scene, SceneObject
from wil_campaign.worlds.scene.shapes import Shape

BODY = BoxShape((0.15, 0.15, 0.05))
EXACT_M = 1e-3
near = st.floats(-1.5, 1.5)
points = st.tuples(near, near, near)
part = st.floats(-1.0, 1.0)


@st.composite
def poses(draw: st.DrawFn) -> Pose:
    q = draw(st.tuples(part, part, part, part).filter(lambda q: math.hypot(*q) > 0.1))
    return Pose(draw(points), quat_normalize(q))


def one(shape: Shape, pose: Pose, motion: ObjectMotion | None = None) -> Scene:
    return Scene((SceneObject(1, "thing", shape, pose, motion),))


def least(found: tuple[Clearance, ...]) -> float:
    return min((each.clearance_m for each in found), default=math.inf)


def triangles_of(vertices: np.ndarray, faces: np.ndarray) -> fcl.CollisionObject:
    model = fcl.BVHModel()
    model.beginModel(len(vertices), len(faces))
    model.addSubModel(vertices, faces)
    model.endModel()
    return fcl.CollisionObject(model)


def box_triangles(half: Vec3) -> fcl.CollisionObject:
    mesh = shapes.box_shape((2 * half[0], 2 * half[1], 2 * half[2])).mesh
    return triangles_of(mesh.vertices_m, mesh.faces)


def sampled(scene: Scene, a: Pose, b: Pose, count: int, t_1_s: float = 1.0) -> float:
    """Least distance between triangle skins at evenly spaced moments: never too small."""
    (thing,) = scene.objects
    body, skin = (
        box_triangles(BODY.half_m),
        triangles_of(thing.shape.mesh.vertices_m, thing.shape.mesh.faces),
    )
    found = math.inf
    for fraction in np.linspace(0.0, 1.0, count):
        pose, place = a.interpolate(b, float(fraction)), thing.pose_at(float(fraction) * t_1_s)
        for solid, at in ((body, pose), (skin, place)):
            rotation = matrix_from_quat(at.q_wxyz)
            solid.setTransform(fcl.Transform(rotation, np.array(at.position_ned_m)))
        found = min(found, max(0.0, fcl.distance(body, skin)))
    return found


def assert_as_sampled(scene: Scene, a: Pose, b: Pose) -> None:
    # Half a turn has two shortest ways.
    assume(angle_between(a.q_wxyz, b.q_wxyz) < math.pi - 1e-3)
    swept = least(ClearanceProbe(scene, BODY, within_m=100.0).sweep(a, 0.0, b, 1.0))
    dense = sampled(scene, a, b, 200)
    way_m = math.dist(a.position_ned_m, b.position_ned_m) + math.pi * BODY.radius_m
    assert swept <= dense + EXACT_M
    assert swept >= dense - way_m / 400 - EXACT_M


@settings(max_examples=40, deadline=None)
@given(poses(), poses(), poses())
@example(
    Pose((0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0)),
    Pose((0.0, 0.0, 0.0), quat_normalize((0.0, 0.25, 1.0, 0.0))),
    Pose((1.0, 0.0, 0.0), quat_normalize((1.0, 1.0, 0.0, 0.0))),
)
def test_box_past_a_square_gate(a: Pose, b: Pose, place: Pose) -> None:
    assert_as_sampled(one(shapes.gate_shape("square", 1.0, 0.1), place), a, b)


@settings(max_examples=25, deadline=None)
@given(poses(), poses())
def test_box_past_a_ring(a: Pose, b: Pose) -> None:
    assert_as_sampled(
        one(shapes.gate_shape("ring", 0.8, 0.06), Pose.of(0, 0, 0, yaw_rad=0.3)), a, b
    )


@settings(max_examples=25, deadline=None)
@given(poses(), poses())
def test_box_past_a_quadrotor(a: Pose, b: Pose) -> None:
    assert_as_sampled(one(shapes.quadrotor_shape(0.5), Pose.of(0, 0, 0.1, pitch_rad=0.2)), a, b)


def box_distance(point: Vec3, half: Vec3) -> float:
    return math.hypot(*(max(abs(c) - h, 0.0) for c, h in zip(point, half, strict=True)))


@settings(max_examples=60, deadline=None)
@given(points, points, poses())
def test_ball_past_a_box_by_formula(a: Vec3, b: Vec3, place: Pose) -> None:
    scene, radius_m = one(shapes.box_shape((0.4, 0.02, 0.8)), place), 0.1
    found = ClearanceProbe(scene, SphereShape(radius_m), within_m=100.0).sweep(
        Pose(a), 0.0, Pose(b), 1.0
    )
    way = (Pose(a).interpolate(Pose(b), f).position_ned_m for f in np.linspace(0, 1, 800))
    exact = min(box_distance(place.to_local(p), (0.2, 0.01, 0.4)) for p in way)
    assert least(found) == pytest.approx(max(0.0, exact - radius_m), abs=EXACT_M + 4e-3)


@settings(max_examples=30, deadline=None)
@given(poses(), poses(), points, points, st.floats(-3.0, 3.0))
@example(Pose.of(1, 0, 0), Pose.of(1, 0.2, 0), (-4e-25, 0.0, 0.0), (-0.8, 0.5, 1.0), 2.0)
def test_both_move_round_a_corner(a: Pose, b: Pose, via: Vec3, end: Vec3, yaw: float) -> None:
    assume(angle_between(a.q_wxyz, b.q_wxyz) < math.pi - 1e-3)
    motion = ObjectMotion(
        Pose((0.0, 0.0, 0.0)),
        (Waypoint(via, 4.0, yaw), Waypoint(end, 6.0)),
        StartAtTime(0.1),
    )
    scene = one(shapes.gate_shape("square", 0.6, 0.1), motion.begin, motion)
    swept = least(ClearanceProbe(scene, BODY, within_m=100.0).sweep(a, 0.0, b, 1.0))
    dense = sampled(scene, a, b, 300)
    assert dense - 0.05 <= swept <= dense + EXACT_M


def test_a_thing_that_jumps_is_measured_before_and_after() -> None:
    """A speed that carries a thing from here to there in no time ends no search."""
    motion = ObjectMotion(Pose.of(3, 0, 0), (Waypoint((3.0, 9.0, 0.0), 1e30),), StartAtTime(0.3))
    scene = one(shapes.gate_shape("square", 0.6, 0.1), motion.begin, motion)
    still = Pose.of(1, 0.35, 0)
    found = least(ClearanceProbe(scene, BODY, within_m=100.0).sweep(still, 0.0, still, 1.0))
    assert found == pytest.approx(1.8, abs=EXACT_M)


@pytest.mark.parametrize("thickness_m", [0.1, 0.001, 1e-5])
@pytest.mark.parametrize("body", [BODY, SphereShape(0.15)], ids=["box", "ball"])
def test_a_thin_sheet_between_two_samples_is_hit(
    thickness_m: float, body: BoxShape | SphereShape
) -> None:
    scene = one(shapes.box_shape((thickness_m, 2.0, 2.0)), Pose.of(0.3, 0, 0))
    found = ClearanceProbe(scene, body).sweep(Pose.of(-5, 0, 0), 3.0, Pose.of(5, 0, 0), 4.0)
    assert found[0].clearance_m == 0.0
    assert found[0].at_s == pytest.approx(3.53, abs=0.02)


def test_a_sheet_of_triangles_is_hit_too() -> None:
    corners = np.array([[0.0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]], np.float64)
    surface = SurfaceShape(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    shape = Shape(
        "mesh", shapes.box_shape((1.0, 1.0, 1.0)).mesh, (SolidPart("s", surface, Pose((0, 0, 0))),)
    )
    probe = ClearanceProbe(one(shape, Pose.of(0, 0, 0)), BODY)
    assert least(probe.sweep(Pose.of(-3, 0, 0), 0.0, Pose.of(3, 0, 0), 1.0)) == 0.0
    beside = probe.sweep(Pose.of(-3, 1.25, 0), 0.0, Pose.of(3, 1.25, 0), 1.0)
    assert least(beside) == pytest.approx(0.1, abs=EXACT_M)


def test_the_middle_of_a_gate_is_no_contact_and_names_the_bar() -> None:
    scene = one(shapes.gate_shape("square", 1.0, 0.1), Pose.of(3, 0, 1.2))
    probe = ClearanceProbe(scene, BODY)
    (found,) = probe.sweep(Pose.of(2, 0.1, 1.2), 0.0, Pose.of(4, 0.1, 1.2), 2.0)
    assert (found.object_name, found.part_name) == ("thing", "right")
    assert found.clearance_m == pytest.approx(0.25, abs=EXACT_M)
    (found,) = probe.sweep(Pose.of(2, 0, 1.7), 0.0, Pose.of(4, 0, 1.7), 2.0)
    assert (found.part_name, found.clearance_m) == ("top", 0.0)


def cage() -> Scene:
    return Scene((SceneObject(1, "cage", shapes.room_shape(6, 6, 2.5), Pose.of(0, 0, 0)),))


def test_inside_of_a_room_is_free_and_its_floor_is_distinguished() -> None:
    probe = ClearanceProbe(cage(), BODY, within_m=10.0)
    walls, floor = probe.sweep(Pose.of(0, 1, 1), 0.0, Pose.of(0, 1, 1), 0.1)
    assert (walls.part_name, walls.is_floor) == ("ceiling", False)
    assert walls.clearance_m == pytest.approx(1.45, abs=EXACT_M)
    assert (floor.part_name, floor.is_floor) == ("floor", True)
    assert floor.clearance_m == pytest.approx(0.95, abs=EXACT_M)


def test_standing_on_the_floor_hides_no_wall() -> None:
    probe = ClearanceProbe(cage(), BODY)
    walls, floor = probe.sweep(Pose.of(2, 0, 0.04), 0.0, Pose.of(2, 0, 0.04), 0.1)
    assert floor.clearance_m == 0.0
    assert walls.part_name == "north wall"
    assert walls.clearance_m == pytest.approx(0.85, abs=EXACT_M)
    (only_walls,) = ClearanceProbe(cage(), BODY, floors=False).sweep(
        Pose.of(2, 0, 0.04), 0.0, Pose.of(2, 0, 0.04), 0.1
    )
    assert not only_walls.is_floor


def test_flying_out_through_a_wall_or_a_corner_is_contact() -> None:
    probe = ClearanceProbe(cage(), BODY, floors=False)
    assert least(probe.sweep(Pose.of(2, 0, 1), 0.0, Pose.of(9, 0, 1), 0.1)) == 0.0
    assert least(probe.sweep(Pose.of(2, 2, 1), 0.0, Pose.of(9, 9, 1), 0.1)) == 0.0


def test_a_far_or_excluded_thing_is_not_reported() -> None:
    scene = one(shapes.gate_shape("square", 1.0, 0.1), Pose.of(30, 0, 1.2))
    still = Pose.of(0, 0, 1)
    assert ClearanceProbe(scene, BODY).sweep(still, 0.0, still, 1.0) == ()
    assert (
        ClearanceProbe(scene, BODY, exclude={"thing"}, within_m=99.0).sweep(still, 0.0, still, 1.0)
        == ()
    )


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_least_of_a_run_is_exact_however_it_is_asked(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene = Scene(
        (
            SceneObject(1, "cage", shapes.room_shape(6, 6, 2.5), Pose.of(0, 0, 0)),
            SceneObject(2, "gate", shapes.gate_shape("square", 1.0, 0.1), Pose.of(1, 0, 1.2)),
        )
    )
    steps = np.cumsum(rng.normal(0.0, 0.04, (60, 3)), axis=0) + np.array([0.0, 0.0, 1.2])
    way = [Pose.of(*step, yaw_rad=0.1 * k) for k, step in enumerate(steps.tolist())]
    probe = ClearanceProbe(scene, BODY)
    known, plain = dict[tuple[str, bool], float](), dict[tuple[str, bool], float]()
    for k in range(59):
        at = (way[k], k * 0.1, way[k + 1], (k + 1) * 0.1)
        closer = probe.sweep(*at, below_m=known)
        known.update((each.key, each.clearance_m) for each in closer)
        near = probe.sweep(*at)
        for each in near:
            plain[each.key] = min(each.clearance_m, plain.get(each.key, math.inf))
        nearest = least(probe.sweep(*at, only_least=True))
        assert nearest == pytest.approx(least(near), abs=EXACT_M)
    assert known.keys() == plain.keys()
    for key, value in known.items():
        assert value == pytest.approx(plain[key], abs=EXACT_M)


def test_equal_questions_get_equal_answers() -> None:
    probe = ClearanceProbe(cage(), BODY)
    a, b = Pose.of(0, 0, 1, roll_rad=0.1), Pose.of(0.5, 1, 1.2, yaw_rad=0.4)
    first = probe.sweep(a, 0.0, b, 1.0)
    probe.sweep(b, 0.0, Pose.of(1, 1, 1), 1.0)
    assert probe.sweep(a, 0.0, b, 1.0) == first


@pytest.mark.parametrize("step_s", [0.0203, 0.04])
def test_a_walking_person_costs_few_measurements_a_stretch(
    step_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured = 0
    gap = BodySolid.gap

    def counted(solid: BodySolid, pose: Pose, part: PartSolid) -> PartGap:
        nonlocal measured
        measured += 1
        return gap(solid, pose, part)

    monkeypatch.setattr(BodySolid, "gap", counted)
    motion = ObjectMotion(Pose((2.5, -1.5, 0.0)), (Waypoint((2.5, 3.0, 0.0), 1.4),))
    scene = one(shapes.person_shape(), motion.begin, motion)
    probe = ClearanceProbe(scene, BODY, within_m=10.0)
    stretches = 50
    for step in range(stretches):
        a, b = (Pose((0.0, 0.3 * at * step_s, -1.2)) for at in (step, step + 1))
        assert probe.sweep(a, step * step_s, b, (step + 1) * step_s)
    assert measured < 120 * stretches
