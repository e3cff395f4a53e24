"""Tracks: where an object is that a vehicle flies, from poses as they come in."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.worlds.frames import Pose, angle_between
from wil_campaign.worlds.scene.motion import AT_REST, ObjectMotion, Waypoint
from wil_campaign.worlds.scene.scene import SceneObject
from wil_campaign.worlds.scene.shapes import quadrotor_shape
from wil_campaign.worlds.scene.track import AHEAD_S, ObjectTrack, RunHistory

STILL = (0.0, 0.0, 0.0)


def track(*poses: tuple[float, Pose]) -> ObjectTrack:
    made = ObjectTrack()
    for t_s, pose in poses:
        made.add(t_s, pose, STILL)
    return made


def test_a_track_has_no_pose_before_its_first() -> None:
    assert ObjectTrack().pose_at(1.0) is None
    assert ObjectTrack().last_s is None
    assert track((2.0, Pose.of(1.0, 0.0, 0.0))).pose_at(1.9) is None


def test_a_track_is_straight_between_its_poses() -> None:
    flown = track((1.0, Pose.of(0.0, 0.0, 0.0)), (2.0, Pose.of(4.0, 0.0, 0.0)))
    pose = flown.pose_at(1.25)
    assert pose is not None
    assert pose.position_ned_m == pytest.approx((1.0, 0.0, 0.0))


def test_a_track_goes_on_at_its_velocity_for_a_moment() -> None:
    flown = ObjectTrack()
    flown.add(1.0, Pose.of(0.0, 0.0, 1.0), (2.0, 0.0, 0.0))
    for ahead_s, north_m in ((0.02, 0.04), (AHEAD_S, 2.0 * AHEAD_S), (9.0, 2.0 * AHEAD_S)):
        pose = flown.pose_at(1.0 + ahead_s)
        assert pose is not None
        assert pose.position_ned_m == pytest.approx((north_m, 0.0, -1.0))
    assert flown.travel(1.0, 20.0).length_m == pytest.approx(2.0 * AHEAD_S)


def test_a_pose_that_is_not_later_is_not_taken() -> None:
    flown = track((1.0, Pose.of(0.0, 0.0, 0.0)))
    assert not flown.add(1.0, Pose.of(9.0, 0.0, 0.0), STILL)
    assert not flown.add(0.5, Pose.of(9.0, 0.0, 0.0), STILL)
    assert flown.pose_at(1.0) == Pose.of(0.0, 0.0, 0.0)


def test_a_track_is_even_within_a_stretch_and_not_over_a_corner() -> None:
    flown = track(
        (0.0, Pose.of(0.0, 0.0, 0.0)),
        (1.0, Pose.of(1.0, 0.0, 0.0)),
        (2.0, Pose.of(1.0, 1.0, 0.0)),
        (3.0, Pose.of(1.0, 1.0, 0.0)),
        (4.0, Pose.of(1.0, 1.0, 0.0, yaw_rad=1.0)),
    )
    assert flown.is_even(0.2, 0.8)
    assert not flown.is_even(0.8, 1.2)
    assert flown.is_even(2.1, 2.9)
    assert not flown.is_even(3.1, 3.2)
    turns_at_0 = track(
        (-1.0, Pose.of(0.0, 0.0, 0.0)), (0.0, Pose.of(1.0, 0.0, 0.0)), (1.0, Pose.of(0.0, 0.0, 0.0))
    )
    assert not turns_at_0.is_even(-1.0, 1.0)


coordinates = st.floats(-5.0, 5.0)
steps = st.lists(
    st.tuples(st.floats(0.01, 0.5), coordinates, coordinates, coordinates, st.floats(-3.0, 3.0)),
    min_size=1,
    max_size=8,
)


@given(steps, st.tuples(coordinates, coordinates, coordinates), st.floats(0, 5), st.floats(0, 5))
def test_nothing_on_a_track_goes_farther_than_its_travel(
    stretches: list[tuple[float, float, float, float, float]],
    velocity: tuple[float, float, float],
    first_s: float,
    later_s: float,
) -> None:
    """Clearance is proven by this bound: a smaller one would let a contact through."""
    flown, t_s = ObjectTrack(), 0.0
    for step_s, north_m, east_m, up_m, yaw_rad in stretches:
        t_s += step_s
        flown.add(t_s, Pose.of(north_m, east_m, up_m, yaw_rad=yaw_rad), velocity)
    travel = flown.travel(first_s, first_s + later_s)
    times = [first_s + later_s * share / 16 for share in range(17)]
    poses = [pose for pose in map(flown.pose_at, times) if pose is not None]
    # Before its first pose a track is where its object stands in the file; that jump is no travel.
    way_m = sum(math.dist(a.position_ned_m, b.position_ned_m) for a, b in pairwise(poses))
    turn_rad = sum(angle_between(a.q_wxyz, b.q_wxyz) for a, b in pairwise(poses))
    assert way_m <= travel.length_m + 1e-6
    assert turn_rad <= travel.turn_rad + 1e-6


def test_an_object_is_where_its_vehicle_is_and_not_where_its_motion_has_it() -> None:
    begin = Pose.of(2.5, 0.0, 0.05)
    motion = ObjectMotion(begin, (Waypoint((2.5, 0.0, -1.0), 1.0),))
    thing = SceneObject(1, "intruder", quadrotor_shape(0.3, (10, 10, 10)), begin, motion)
    history = RunHistory({"intruder": ObjectTrack()})
    # Nothing known yet: it stands where it starts, though its motion is over.
    assert thing.pose_at(9.0, history) == begin
    assert thing.travel(0.0, 9.0, history) == AT_REST
    assert thing.is_even(0.0, 9.0, history)
    history.add_pose("intruder", 9.0, Pose.of(2.0, 0.1, 0.7), STILL)
    assert thing.pose_at(9.0, history) == Pose.of(2.0, 0.1, 0.7)
    assert thing.pose_at(9.0, {}) == Pose.of(2.5, 0.0, 1.0)
