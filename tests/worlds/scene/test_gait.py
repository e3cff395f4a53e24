"""Limbs of a walking person: where they are on the way, and how far they move at most."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.worlds.clearance.clearance import BoxShape, ClearanceProbe
from wil_campaign.worlds.frames import Pose, Vec3, angle_between, norm, subtract
from wil_campaign.worlds.rays.raycast import SceneRayCaster
from wil_campaign.worlds.scene import shapes
from wil_campaign.worlds.scene.gait import ANKLE_M, CHORD_S, HIP_M, JOINTS, Joint, limb_pose, step_m
from wil_campaign.worlds.scene.motion import LegStride, ObjectMotion, Waypoint
from wil_campaign.worlds.scene.scene import Scene, SceneObject

PERSON = shapes.person_shape()
BEGIN = Pose.of(0.0, 0.0, 0.0, yaw_rad=math.pi / 2)
WALK = ObjectMotion(BEGIN, (Waypoint((0.0, 6.0, 0.0), 1.4),), acceleration_m_s2=1.4)
WALKER = SceneObject(1, "walker", PERSON, BEGIN, WALK)


def test_the_limbs_are_the_whole_person() -> None:
    parts = [part.name for limb in PERSON.limbs for part in limb.shape.parts]
    assert sorted(parts) == sorted(part.name for part in PERSON.parts)
    assert tuple(limb.joint for limb in PERSON.limbs) == JOINTS


@pytest.mark.parametrize("joint", JOINTS)
def test_a_person_stands_upright_before_and_after_the_way(joint: Joint) -> None:
    for stride in (None, LegStride(0.0, 3.0, 1.4), LegStride(3.0, 3.0, 1.4)):
        pose = limb_pose(joint, stride)
        assert norm(pose.position_ned_m) < 1e-9
        assert abs(pose.q_wxyz[0]) == pytest.approx(1.0)


def test_half_a_step_in_the_legs_are_apart_by_a_step() -> None:
    length_m = step_m(1.4)
    assert length_m == pytest.approx(0.74, abs=0.01)
    stride = LegStride(2.5 * length_m, 9.0, 1.4)
    ankle: Vec3 = (0.0, 0.0, -ANKLE_M)
    right, left = (
        limb_pose(joint, stride).to_parent(ankle) for joint in ("right foot", "left foot")
    )
    assert right[0] - left[0] == pytest.approx(length_m * (HIP_M - ANKLE_M) / HIP_M, abs=1e-6)
    assert right[2] == pytest.approx(-ANKLE_M, abs=1e-6)
    assert left[2] == pytest.approx(-ANKLE_M, abs=1e-6)


def test_no_foot_is_below_the_floor_and_the_swinging_one_is_lifted() -> None:
    highest_m = 0.0
    for along_m in np.arange(0.0, 6.0, 0.02):
        for joint in ("right foot", "left foot"):
            down_m = limb_pose(joint, LegStride(float(along_m), 6.0, 1.4)).position_ned_m[2]
            assert down_m <= 1e-9
            highest_m = max(highest_m, -down_m)
    assert 0.05 < highest_m < 0.3


@given(st.sampled_from(range(9)), st.floats(0.0, 6.0), st.floats(0.001, 0.5))
def test_travel_bounds_the_way_and_turn_of_every_limb(which: int, t_s: float, dt_s: float) -> None:
    body = WALKER.bodies[which]
    first, last = body.pose_at(t_s), body.pose_at(t_s + dt_s)
    travel = body.travel(t_s, t_s + dt_s)
    way_m = norm(subtract(last.position_ned_m, first.position_ned_m))
    assert way_m <= travel.length_m + 1e-9
    assert angle_between(first.q_wxyz, last.q_wxyz) <= travel.turn_rad + 1e-6


def test_a_leg_that_swings_forward_is_touched_where_the_standing_one_is_not() -> None:
    scene = Scene((WALKER,))
    probe = ClearanceProbe(scene, BoxShape((0.01, 0.01, 0.01)))
    ray = SceneRayCaster(scene)
    times = np.arange(1.5, 3.0, 0.02)
    least_m, hit = math.inf, False
    for t_s in times:
        east_m = WALKER.pose_at(float(t_s)).position_ned_m[1]
        at = Pose((0.09, east_m + 0.33, -0.12))
        (found,) = probe.sweep(at, float(t_s), at, float(t_s))
        least_m = min(least_m, found.clearance_m)
        down = np.array([[0.0, 0.0, 1.0]])
        hit |= bool(ray.cast((0.09, east_m + 0.33, -0.3), down, float(t_s)).object_ids[0] == 1)
    assert least_m == 0.0
    assert hit
    standing = SceneObject(1, "stander", PERSON, BEGIN)
    probe = ClearanceProbe(Scene((standing,)), BoxShape((0.01, 0.01, 0.01)))
    at = Pose((0.09, 0.33, -0.12))
    (found,) = probe.sweep(at, 0.0, at, 0.0)
    assert found.clearance_m > 0.1


def test_one_clearance_is_reported_of_all_limbs_and_it_is_the_least() -> None:
    scene = Scene((WALKER,))
    probe = ClearanceProbe(scene, BoxShape((0.1, 0.1, 0.1)), within_m=5.0)
    apart = []
    for body in WALKER.bodies:
        alone = shapes.Shape("limb", body.shape.mesh, body.shape.parts)
        pose = body.pose_at(2.0)
        single = Scene((SceneObject(1, "limb", alone, pose),))
        at = Pose((1.0, 1.5, -1.0))
        (found,) = ClearanceProbe(single, BoxShape((0.1, 0.1, 0.1)), within_m=5.0).sweep(
            at, 2.0, at, 2.0
        )
        apart.append(found.clearance_m)
    (whole,) = probe.sweep(Pose((1.0, 1.5, -1.0)), 2.0, Pose((1.0, 1.5, -1.0)), 2.0)
    assert whole.clearance_m == pytest.approx(min(apart), abs=1e-3)


@pytest.mark.parametrize(("speed_m_s", "within_m"), [(1.4, 0.01), (2.5, 0.03)])
def test_a_limb_goes_nearly_straight_between_two_samples(speed_m_s: float, within_m: float) -> None:
    walk = ObjectMotion(BEGIN, (Waypoint((0.0, 6.0, 0.0), speed_m_s),), acceleration_m_s2=speed_m_s)
    walker = SceneObject(1, "walker", PERSON, BEGIN, walk)
    worst_m = 0.0
    for body in walker.bodies:
        tip = body.shape.mesh.vertices_m[int(np.argmax(body.shape.mesh.vertices_m[:, 2]))]
        point: Vec3 = (float(tip[0]), float(tip[1]), float(tip[2]))
        for t_s in np.arange(0.0, 6.0, 0.013):
            first, last = (body.pose_at(t).to_parent(point) for t in (t_s, t_s + CHORD_S))
            there = body.pose_at(t_s + CHORD_S / 2).to_parent(point)
            middle = tuple((a + b) / 2 for a, b in zip(first, last, strict=True))
            worst_m = max(worst_m, math.dist(there, middle))
    assert 0.0001 < worst_m < within_m
