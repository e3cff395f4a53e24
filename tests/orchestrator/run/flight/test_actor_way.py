"""The way of an actor, from its object's motion."""

import math

import pytest

from orchestrator.run.stages.actor_way import ActorWay
from worlds.frames import Pose
from worlds.scene.motion import Motion, Waypoint

WAY = ActorWay(
    Motion(
        Pose.of(2.5, 0.0, 0.0, yaw_rad=math.pi),
        (Waypoint((2.5, 0.0, -1.0), 0.5), Waypoint((-0.5, 0.0, -1.0), 1.0)),
    )
)


def test_the_way_begins_with_the_climb_and_ends_at_the_last_waypoint() -> None:
    assert WAY.climb_m == pytest.approx(1.0)
    assert WAY.pose_at(1.0).position_ned_m == pytest.approx((2.5, 0.0, -0.5))
    assert WAY.pose_at(3.0).position_ned_m == pytest.approx((1.5, 0.0, -1.0))
    assert WAY.pose_at(60.0).position_ned_m == pytest.approx((-0.5, 0.0, -1.0))


def test_it_climbs_to_the_first_waypoint_whatever_comes_after_it() -> None:
    begin, higher = Pose.of(2.5, 0.0, 0.0), Waypoint((-0.5, 0.0, -3.0), 1.0)
    first = Waypoint((2.5, 0.0, -1.0), 0.5)
    for waypoints in ((first, higher), (first,)):
        assert ActorWay(Motion(begin, waypoints)).climb_m == pytest.approx(1.0)


def test_velocity_and_speed_are_those_of_the_leg() -> None:
    assert WAY.velocity_at(1.0) == pytest.approx((0.0, 0.0, -0.5))
    assert WAY.velocity_at(3.0) == pytest.approx((-1.0, 0.0, 0.0))
    assert WAY.velocity_at(60.0) == pytest.approx((0.0, 0.0, 0.0))
    assert (WAY.speed_at(1.0), WAY.speed_at(3.0), WAY.speed_at(60.0)) == (0.5, 1.0, 1.0)


@pytest.mark.parametrize(
    ("place", "off_m"),
    [
        ((2.5, 0.0, -0.4), 0.0),
        ((1.0, 0.3, -1.0), 0.3),
        ((2.5, 0.0, -1.5), 0.5),
        ((-0.9, 0.0, -1.3), 0.5),
    ],
)
def test_a_place_is_as_far_off_as_the_nearest_of_the_way(
    place: tuple[float, float, float], off_m: float
) -> None:
    assert WAY.distance_m(place) == pytest.approx(off_m)
