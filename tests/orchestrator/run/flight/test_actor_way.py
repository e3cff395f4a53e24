"""The way of an actor, from its object's motion."""

import math

import pytest

from wil_campaign.orchestrator.run.stages.actor_flight import ActorProgress, ActorWay
from wil_campaign.worlds.frames import Pose, Vec3
from wil_campaign.worlds.scene.motion import ObjectMotion, Waypoint

WAY = ActorWay(
    ObjectMotion(
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
        assert ActorWay(ObjectMotion(begin, waypoints)).climb_m == pytest.approx(1.0)


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


def behind(way: ActorWay, places: dict[float, Vec3]) -> list[float]:
    """Return how far behind an actor is that is at these places at these times."""
    progress = ActorProgress(way)
    return [progress.behind_s(place, t_s) for t_s, place in places.items()]


def at(way: ActorWay, t_s: float) -> Vec3:
    return way.pose_at(t_s).position_ned_m


@pytest.mark.parametrize("late_s", [0.0, 0.5, 2.4])
def test_an_actor_that_flies_its_motion_later_stays_as_far_behind(late_s: float) -> None:
    times_s = [0.1 * tick for tick in range(80)]
    found = behind(WAY, {t_s: at(WAY, max(0.0, t_s - late_s)) for t_s in times_s})
    for t_s, behind_s in zip(times_s, found, strict=True):
        # When the motion has ended, the actor has only the rest of it to fly.
        assert behind_s == pytest.approx(min(t_s, 5.0) - min(max(0.0, t_s - late_s), 5.0), abs=0.06)


def test_an_actor_that_is_too_slow_falls_further_and_further_behind() -> None:
    way = {1.0 + tick: at(WAY, 1.0 + 0.3 * tick) for tick in range(5)}
    assert behind(WAY, way) == pytest.approx([0.0, 0.7, 1.4, 2.1, 2.8], abs=0.06)


def test_an_actor_that_stands_where_the_path_crosses_itself_falls_behind() -> None:
    """The path comes back to its second waypoint after 6 s: only from then on that is its place."""
    corners: tuple[Vec3, ...] = ((0, 0, -1), (2, 0, -1), (4, 2, -1), (4, -2, -1), (2, 0, -1))
    way = ActorWay(
        ObjectMotion(Pose.of(0, 0, 0), tuple(Waypoint(corner, 1.0) for corner in corners))
    )
    found = behind(way, {t_s: at(way, min(t_s, 3.0)) for t_s in (1.0, 2.0, 3.0, 4.0, 6.0, 8.0)})
    assert found == pytest.approx([0.0, 0.0, 0.0, 1.0, 3.0, 5.0], abs=0.06)


def test_an_actor_is_not_late_for_what_it_has_flown_before() -> None:
    """There and back on one line: each place of it is passed twice."""
    corners: tuple[Vec3, ...] = ((0, 0, -1), (2, 0, -1), (0, 0, -1))
    way = ActorWay(
        ObjectMotion(Pose.of(0, 0, 0), tuple(Waypoint(corner, 1.0) for corner in corners))
    )
    times_s = [0.1 * tick for tick in range(60)]
    found = behind(way, {t_s: at(way, max(0.0, t_s - 0.4)) for t_s in times_s})
    assert max(found) == pytest.approx(0.4, abs=0.06)
    assert found[-1] == 0.0


def test_an_actor_that_turns_with_its_motion_is_not_behind_it() -> None:
    turned = Waypoint((2.5, 0.0, -1.0), 0.5, yaw_rad=0.0)
    begin = Pose.of(2.5, 0.0, 0.0, yaw_rad=math.pi)
    way = ActorWay(ObjectMotion(begin, (Waypoint((2.5, 0.0, -1.0), 0.5), turned)))
    assert way.duration_s == pytest.approx(3.0)
    assert behind(way, {2.0: at(way, 2.0), 2.8: at(way, 2.8)}) == pytest.approx([0.0, 0.0])
