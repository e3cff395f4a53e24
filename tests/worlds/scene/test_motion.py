"""Motion scripts: where things are, when they start, and how far they went."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.worlds.frames import Pose, Vec3, angle_between, euler_from_quat, norm, subtract
from wil_campaign.worlds.scene.motion import (
    TURN_RATE_RAD_S,
    ObjectMotion,
    StartAtTime,
    StartOnEvent,
    Waypoint,
)

BEGIN = Pose.of(0, 0, 1)
TILTED = Pose.of(0, 0, 1, yaw_rad=0.4, pitch_rad=math.pi / 6, roll_rad=-0.2)
L_WAY = (Waypoint((4.0, 0.0, -1.0), 2.0), Waypoint((4.0, 3.0, -1.0), 1.0, math.pi / 2))
times = st.floats(-5.0, 60.0)
coordinate = st.floats(-5.0, 5.0)
waypoints = st.builds(
    Waypoint,
    st.tuples(coordinate, coordinate, coordinate),
    st.floats(0.1, 5.0),
    st.none() | st.floats(-3.0, 3.0),
)
motions = st.builds(
    ObjectMotion,
    st.sampled_from([BEGIN, TILTED]),
    st.lists(waypoints, min_size=1, max_size=4).map(tuple),
    st.builds(StartAtTime, st.floats(0.0, 3.0))
    | st.builds(StartOnEvent, st.just("go"), st.floats(0, 2)),
    st.booleans(),
    st.none() | st.floats(0.2, 10.0),
)
EVENTS = {"go": 1.5}


def place(motion: ObjectMotion, t_s: float, events: dict[str, float] | None = None) -> Vec3:
    return motion.pose_at(t_s, events or {}).position_ned_m


def test_it_goes_at_each_ways_speed_and_then_stays() -> None:
    motion = ObjectMotion(BEGIN, L_WAY, StartAtTime(2.0))
    assert place(motion, 0.0) == place(motion, 2.0) == BEGIN.position_ned_m
    assert place(motion, 3.0) == pytest.approx((2.0, 0.0, -1.0))
    assert place(motion, 4.0) == pytest.approx((4.0, 0.0, -1.0))
    assert place(motion, 5.5) == pytest.approx((4.0, 1.5, -1.0))
    assert place(motion, 99.0) == pytest.approx((4.0, 3.0, -1.0))
    assert motion.duration_s == pytest.approx(5.0)


def test_it_turns_on_the_way_and_keeps_its_heading_else() -> None:
    motion = ObjectMotion(BEGIN, L_WAY)
    assert motion.pose_at(1.0, {}).yaw_rad == pytest.approx(0.0)
    assert motion.pose_at(3.5, {}).yaw_rad == pytest.approx(math.pi / 4)
    assert motion.pose_at(9.0, {}).yaw_rad == pytest.approx(math.pi / 2)


def test_it_turns_on_the_spot_when_it_has_nowhere_to_go() -> None:
    motion = ObjectMotion(BEGIN, (Waypoint(BEGIN.position_ned_m, 1.0, math.pi / 2),))
    assert motion.duration_s == pytest.approx(math.pi / 2 / TURN_RATE_RAD_S)
    assert motion.pose_at(99.0, {}).yaw_rad == pytest.approx(math.pi / 2)


@pytest.mark.parametrize("way_m", [1e-25, 1e-6, 0.1])
def test_a_way_too_short_for_its_turn_is_gone_more_slowly(way_m: float) -> None:
    motion = ObjectMotion(BEGIN, (Waypoint((way_m, 0.0, -1.0), 4.0, math.pi / 2),))
    assert motion.duration_s == pytest.approx(math.pi / 2 / TURN_RATE_RAD_S)
    assert motion.pose_at(0.25, {}).yaw_rad == pytest.approx(math.pi / 4)


def test_a_round_may_be_as_short_as_it_likes() -> None:
    motion = ObjectMotion(BEGIN, (Waypoint((1e-12, 0.0, -1.0), 1.0),), loop=True)
    assert motion.travel(0.0, 100.0, {}).length_m == pytest.approx(100.0)


def test_it_waits_for_its_event_and_the_delay() -> None:
    motion = ObjectMotion(BEGIN, L_WAY, StartOnEvent("seen", 0.5))
    assert place(motion, 50.0) == BEGIN.position_ned_m
    assert place(motion, 50.0, {"other": 1.0}) == BEGIN.position_ned_m
    assert place(motion, 11.0, {"seen": 10.0}) == pytest.approx((1.0, 0.0, -1.0))


def test_a_loop_leads_back_and_round() -> None:
    motion = ObjectMotion(BEGIN, (Waypoint((2.0, 0.0, -1.0), 1.0),), loop=True)
    assert place(motion, 3.0) == pytest.approx((1.0, 0.0, -1.0))
    assert place(motion, 4.0) == pytest.approx((0.0, 0.0, -1.0))
    assert place(motion, 401.5) == pytest.approx((1.5, 0.0, -1.0))


def test_a_tilted_thing_stays_tilted_on_the_way_back() -> None:
    motion = ObjectMotion(TILTED, (Waypoint((2.0, 0.0, -1.0), 1.0),), loop=True)
    for t_s in (0.5, 2.0, 3.0, 3.999, 4.001, 7.5):
        assert motion.pose_at(t_s, {}).q_wxyz == pytest.approx(TILTED.q_wxyz)
    assert motion.is_even(2.5, 3.5, {})


@pytest.mark.parametrize("yaw_rad", [1.2, -2.8])
def test_a_tilted_thing_turns_about_the_vertical(yaw_rad: float) -> None:
    there = Waypoint((4.0, 0.0, -1.0), 1.0, yaw_rad)
    motion = ObjectMotion(TILTED, (there,), loop=True)
    roll_rad, pitch_rad, _ = euler_from_quat(TILTED.q_wxyz)
    turned = euler_from_quat(motion.pose_at(4.0, {}).q_wxyz)
    assert turned == pytest.approx((roll_rad, pitch_rad, yaw_rad))
    closed = motion.pose_at(8.0 - 1e-9, {})
    assert angle_between(closed.q_wxyz, TILTED.q_wxyz) < 1e-6


def test_a_thing_that_looks_straight_up_turns_too() -> None:
    up = Pose.of(0, 0, 1, yaw_rad=0.4, pitch_rad=math.pi / 2)
    motion = ObjectMotion(up, (Waypoint((4.0, 0.0, -1.0), 1.0, 1.4),))
    wanted = Pose.of(4, 0, 1, yaw_rad=1.4, pitch_rad=math.pi / 2)
    assert angle_between(motion.pose_at(4.0, {}).q_wxyz, wanted.q_wxyz) < 1e-6


def test_going_nowhere_is_rest() -> None:
    motion = ObjectMotion(BEGIN, (Waypoint(BEGIN.position_ned_m, 1.0),), loop=True)
    assert place(motion, 7.0) == BEGIN.position_ned_m
    assert motion.is_even(0.0, 9.0, {})


@given(motions, times, st.floats(0.0, 20.0))
def test_travel_bounds_the_way_and_the_turn(motion: ObjectMotion, t_s: float, dt_s: float) -> None:
    first, last = motion.pose_at(t_s, EVENTS), motion.pose_at(t_s + dt_s, EVENTS)
    travel = motion.travel(t_s, t_s + dt_s, EVENTS)
    way_m = norm(subtract(last.position_ned_m, first.position_ned_m))
    assert way_m <= travel.length_m + 1e-6
    assert angle_between(first.q_wxyz, last.q_wxyz) <= travel.turn_rad + 1e-5


@given(motions, times, st.floats(0.0, 5.0), st.floats(0.0, 5.0))
def test_travel_adds_up(motion: ObjectMotion, t_s: float, a_s: float, b_s: float) -> None:
    whole = motion.travel(t_s, t_s + a_s + b_s, EVENTS)
    parts = [
        motion.travel(t_s, t_s + a_s, EVENTS),
        motion.travel(t_s + a_s, t_s + a_s + b_s, EVENTS),
    ]
    assert whole.length_m == pytest.approx(sum(part.length_m for part in parts), abs=1e-6)
    assert whole.turn_rad == pytest.approx(sum(part.turn_rad for part in parts), abs=1e-6)


@given(motions, times, st.floats(0.0, 3.0), st.floats(0.0, 1.0))
def test_even_motion_is_a_straight_line(
    motion: ObjectMotion, t_s: float, dt_s: float, fraction: float
) -> None:
    if motion.is_even(t_s, t_s + dt_s, EVENTS):
        first, last = motion.pose_at(t_s, EVENTS), motion.pose_at(t_s + dt_s, EVENTS)
        middle = motion.pose_at(t_s + fraction * dt_s, EVENTS)
        expected = first.interpolate(last, fraction)
        gap = norm(subtract(middle.position_ned_m, expected.position_ned_m))
        assert gap < 1e-6
        assert angle_between(middle.q_wxyz, expected.q_wxyz) < 1e-6


def test_even_motion_ends_at_a_corner() -> None:
    motion = ObjectMotion(BEGIN, (*L_WAY[:1], Waypoint((4.0, 3.0, -1.0), 1.0)))
    assert motion.is_even(0.5, 1.9, {})
    assert not motion.is_even(1.9, 2.1, {})
    assert not motion.is_even(-0.1, 0.1, {})
    assert motion.is_even(50.0, 60.0, {})


def test_with_an_acceleration_each_way_begins_and_ends_at_rest() -> None:
    motion = ObjectMotion(BEGIN, (Waypoint((4.0, 0.0, -1.0), 2.0),), acceleration_m_s2=2.0)
    assert motion.duration_s == pytest.approx(3.0)
    assert place(motion, 0.5)[0] == pytest.approx(0.25)
    assert place(motion, 1.0)[0] == pytest.approx(1.0)
    assert place(motion, 2.0)[0] == pytest.approx(3.0)
    assert place(motion, 2.5)[0] == pytest.approx(3.75)
    assert motion.is_even(1.0, 2.0, {})
    assert not motion.is_even(0.9, 1.1, {})


def test_a_way_too_short_for_its_speed_is_sped_up_and_slowed_down() -> None:
    motion = ObjectMotion(BEGIN, (Waypoint((1.0, 0.0, -1.0), 9.0),), acceleration_m_s2=1.0)
    assert motion.duration_s == pytest.approx(2.0)
    assert place(motion, 1.0)[0] == pytest.approx(0.5)
    assert place(motion, 0.5)[0] == pytest.approx(0.125)


@given(motions, times)
def test_a_turn_is_never_faster_than_its_bound(motion: ObjectMotion, t_s: float) -> None:
    step_s = 0.01
    first, last = motion.pose_at(t_s, EVENTS), motion.pose_at(t_s + step_s, EVENTS)
    turned_rad = angle_between(first.q_wxyz, last.q_wxyz)
    assert turned_rad <= TURN_RATE_RAD_S * step_s * (1.0 + 1e-6) + 1e-5


def test_speeds_are_drawn_once_for_each_way_about_the_speed_of_the_file() -> None:
    motion = ObjectMotion(BEGIN, L_WAY, speed_sd_m_s=0.2)
    drawn = motion.drawn(np.random.default_rng(1))
    assert drawn == motion.drawn(np.random.default_rng(1))
    assert drawn != motion.drawn(np.random.default_rng(2))
    speeds = [
        waypoint.speed_m_s
        for seed in range(400)
        for waypoint in motion.drawn(np.random.default_rng(seed)).waypoints[:1]
    ]
    assert np.mean(speeds) == pytest.approx(2.0, abs=0.03)
    assert np.std(speeds) == pytest.approx(0.2, abs=0.02)
    assert ObjectMotion(BEGIN, L_WAY).drawn(np.random.default_rng(1)) == ObjectMotion(BEGIN, L_WAY)


def test_a_drawn_speed_is_never_backwards() -> None:
    motion = ObjectMotion(BEGIN, L_WAY, speed_sd_m_s=50.0)
    for seed in range(50):
        speeds = [
            waypoint.speed_m_s for waypoint in motion.drawn(np.random.default_rng(seed)).waypoints
        ]
        assert min(speeds) > 0.0
