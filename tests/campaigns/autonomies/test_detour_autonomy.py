"""Detour flies to a place ahead, round boxes that its depth camera sees, and keeps its distance."""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
import pytest

from tests.campaigns.autonomies.point_mass import Flight
from wil_campaign.api import (
    DepthReading,
    Intrinsics,
    Pose,
    Telemetry,
    VelocitySetpoint,
    quat_from_euler,
)
from wil_campaign.campaigns.autonomies.detour import DetourAutonomy
from wil_campaign.campaigns.autonomies.obstacle_map import ObstacleMap, free_ways

CAMERA = Intrinsics.from_fov(160, 90, math.radians(87.0))
STEP_S, IMAGE_S, LAG_S, LATE_S, TURN_RAD_S = 0.05, 0.1, 0.35, 0.08, 1.0
Posts = tuple[tuple[float, float, float], ...]
"""Round posts, as high as can be: north, east, radius."""


def depth_image(pose: Pose, t_s: float, posts: Posts) -> DepthReading:
    """What a level camera sees of posts: each column's depth by a ray and circles."""
    columns = (np.arange(CAMERA.width_px) - CAMERA.cx_px) / CAMERA.fx_px
    rays = np.stack([np.ones_like(columns), columns], axis=1)
    cos, sin = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
    depth = np.full(CAMERA.width_px, np.inf)
    for north_m, east_m, radius_m in posts:
        north, east = north_m - pose.position_ned_m[0], east_m - pose.position_ned_m[1]
        ahead, right = north * cos + east * sin, east * cos - north * sin
        a = (rays**2).sum(axis=1)
        b = rays @ np.array([ahead, right])
        root = b * b - a * (ahead * ahead + right * right - radius_m * radius_m)
        hit = (root >= 0.0) & (b > 0.0)
        found = np.where(hit, (b - np.sqrt(np.maximum(root, 0.0))) / a, np.inf)
        depth = np.minimum(depth, found)
    image = np.tile(depth, (CAMERA.height_px, 1)).astype(np.float32)
    return DepthReading(t_s, t_s + LATE_S, 0, "mixed", image, CAMERA)


@dataclass
class Flown:
    """A flight, and how near its middle came to the posts."""

    flight: Flight
    near_m: float


def fly(posts: Posts, *, until_s: float = 70.0, **parameters: object) -> Flown:
    """Fly a point mass from the origin at 1.5 m, heading north; it turns no faster than it can."""
    autonomy = DetourAutonomy(goal={"altitude_m": 1.5}, parameters=parameters, seed=1)
    flown = Flown(Flight(), math.inf)
    position, velocity, yaw_rad = np.array([0.0, 0.0, -1.5]), np.zeros(3), 0.0
    waiting: deque[DepthReading] = deque()
    for step in range(int(until_s / STEP_S)):
        t_s = step * STEP_S
        north, east, down = position.tolist()
        pose = Pose((north, east, down), quat_from_euler(0.0, 0.0, yaw_rad))
        flown.flight.path.append((t_s, pose.position_ned_m))
        for post in posts:
            flown.near_m = min(flown.near_m, math.hypot(north - post[0], east - post[1]) - post[2])
        if step % round(IMAGE_S / STEP_S) == 0:
            waiting.append(depth_image(pose, t_s, posts))
        while waiting and waiting[0].arrived_s <= t_s:
            autonomy.perceive(waiting.popleft())
        v_north, v_east, v_down = velocity.tolist()
        command = autonomy.act(Telemetry(t_s, pose, (v_north, v_east, v_down)))
        flown.flight.commands.append(command)
        if command.done:
            break
        setpoint = command.setpoint
        assert isinstance(setpoint, VelocitySetpoint)
        assert setpoint.yaw_rad is not None
        turn_rad = (setpoint.yaw_rad - yaw_rad + math.pi) % (2.0 * math.pi) - math.pi
        yaw_rad += min(max(turn_rad, -TURN_RAD_S * STEP_S), TURN_RAD_S * STEP_S)
        velocity += (np.array(setpoint.velocity_ned_m_s) - velocity) / LAG_S * STEP_S
        position += velocity * STEP_S
    return flown


def test_it_flies_straight_to_a_place_with_nothing_in_the_way_and_stops() -> None:
    flown = fly((), ahead_m=10)
    assert flown.flight.commands[-1].done
    assert flown.flight.notes()[-1] == "stop"
    _, (north_m, east_m, down_m) = flown.flight.path[-1]
    assert north_m == pytest.approx(10.0, abs=0.4)
    assert east_m == pytest.approx(0.0, abs=0.05)
    assert down_m == pytest.approx(-1.5, abs=0.05)
    assert flown.flight.path[-1][0] < 12.0


@pytest.mark.parametrize("east_m", [0.0, 0.4, -0.4])
def test_it_goes_round_a_post_and_keeps_its_distance(east_m: float) -> None:
    flown = fly(((8.0, east_m, 0.8),), ahead_m=16)
    assert flown.flight.commands[-1].done
    assert flown.flight.path[-1][1][0] == pytest.approx(16.0, abs=0.4)
    assert flown.near_m > 1.4
    # It goes by on the nearer side.
    aside_m = max((place[1] for _, place in flown.flight.path), key=abs)
    assert east_m == 0.0 or aside_m * east_m < 0.0


def test_it_flies_through_a_gap_rather_than_far_round() -> None:
    flown = fly(((8.0, -2.2, 0.8), (8.0, 2.2, 0.8)), ahead_m=16)
    assert flown.flight.commands[-1].done
    assert flown.near_m > 0.9
    assert max(abs(place[1]) for _, place in flown.flight.path) < 1.5


def test_it_gives_up_before_an_endless_wall_and_touches_nothing() -> None:
    wall = tuple((6.0, east_m, 0.5) for east_m in np.arange(-30.0, 30.5, 0.5).tolist())
    flown = fly(wall, ahead_m=16, until_s=25.0)
    assert flown.near_m > 0.4
    assert flown.flight.path[-1][1][0] < 6.0


def test_it_gives_up_when_its_time_is_over() -> None:
    assert not fly((), ahead_m=40, until_s=5.0).flight.commands[-1].done
    flown = fly((), ahead_m=40, for_s=3.0)
    assert flown.flight.notes()[-1] == "gave up"
    assert flown.flight.commands[-1].done


def test_the_map_keeps_points_for_its_memory_and_takes_no_noise() -> None:
    here = Pose((0.0, 0.0, -1.5))
    seen = ObstacleMap(look_m=6.0, half_height_m=0.5, memory_s=2.0)
    seen.add(depth_image(here, 1.0, ((4.0, 0.0, 0.5),)), here, here.q_wxyz)
    offsets = seen.offsets(here, 2.9)
    assert offsets[:, 0].min() == pytest.approx(3.5, abs=0.2)
    assert np.abs(offsets[:, 1]).max() < 0.7
    assert len(seen.offsets(here, 3.1)) == 0
    lone = depth_image(here, 4.0, ())
    lone.depth_m[45, 81] = 3.0
    seen.add(lone, here, here.q_wxyz)
    assert len(seen.offsets(here, 4.0)) == 0


def test_a_free_way_knows_the_distance_of_obstacles_beside_it() -> None:
    ways = free_ways(np.array([[4.0, 1.0]]), least_m=0.5, within_m=6.0)
    north = int(np.argmin(np.abs(ways.headings_rad)))
    assert ways.beside_m[north] == pytest.approx(1.0)
    assert ways.ahead_m[north] == 6.0
    at_it = int(np.argmin(np.abs(ways.headings_rad - math.atan2(1.0, 4.0))))
    assert ways.beside_m[at_it] < 0.2
    assert ways.ahead_m[at_it] == pytest.approx(math.hypot(4.0, 1.0) - 0.5, abs=0.05)
    south = int(np.argmin(np.abs(ways.headings_rad - math.pi)))
    assert ways.beside_m[south] == math.inf
    empty = free_ways(np.empty((0, 2)), least_m=0.5, within_m=6.0)
    assert (empty.ahead_m == 6.0).all()


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"speed": 1}, "unknown parameter 'speed'"),
        ({"look_m": 0}, "look_m must be greater than 0"),
        ({"keep_m": 0.5}, "keep_m must be at least least_m, 0.8"),
        ({"camera_stabilized": 1}, "must be true or false"),
    ],
)
def test_wrong_parameters_are_refused(parameters: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        DetourAutonomy(goal={"altitude_m": 1.5}, parameters=parameters, seed=1)
