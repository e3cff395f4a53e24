"""The anchor: local frame to world frame and back."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.vehicles.errors import AnchorError
from wil_campaign.vehicles.poses.anchor import Anchor, PoseAverage
from wil_campaign.vehicles.setpoints import PositionSetpoint, VelocitySetpoint
from wil_campaign.worlds.frames import Pose, angle_between, norm, quat_from_euler, rotate, subtract

metres = st.floats(-1000.0, 1000.0)
angles_rad = st.floats(-math.pi, math.pi)
points = st.tuples(metres, metres, metres)


def _level(point: tuple[float, float, float], yaw_rad: float) -> Pose:
    return Pose(point, quat_from_euler(0.0, 0.0, yaw_rad))


@given(local=points, local_yaw=angles_rad, world=points, world_yaw=angles_rad)
def test_maps_the_captured_pose_onto_the_start(
    local: tuple[float, float, float],
    local_yaw: float,
    world: tuple[float, float, float],
    world_yaw: float,
) -> None:
    captured, start = _level(local, local_yaw), _level(world, world_yaw)
    mapped = Anchor.of_poses(local=captured, world=start).pose(captured)
    assert norm(subtract(mapped.position_ned_m, world)) < 1e-6
    assert angle_between(mapped.q_wxyz, start.q_wxyz) < 1e-6


@given(origin=points, turn=angles_rad, point=points, ahead=points, yaw=angles_rad)
def test_pose_velocity_and_position_turn_alike(
    origin: tuple[float, float, float],
    turn: float,
    point: tuple[float, float, float],
    ahead: tuple[float, float, float],
    yaw: float,
) -> None:
    anchor = Anchor(origin, turn)
    pose = Pose(point, quat_from_euler(-0.4, 0.3, yaw))
    mapped = anchor.pose(pose)
    # A point fixed to the body is the same point whichever way it is mapped.
    by_body = mapped.to_parent(ahead)
    by_anchor = anchor.position(pose.to_parent(ahead))
    assert norm(subtract(by_body, by_anchor)) < 1e-6
    body_velocity = rotate(pose.q_wxyz, ahead)
    assert norm(subtract(anchor.velocity(body_velocity), rotate(mapped.q_wxyz, ahead))) < 1e-6


@given(origin=points, turn=angles_rad, point=points, yaw=angles_rad)
def test_setpoints_go_back(
    origin: tuple[float, float, float], turn: float, point: tuple[float, float, float], yaw: float
) -> None:
    anchor = Anchor(origin, turn)
    there = anchor.to_local(PositionSetpoint(point, yaw))
    assert isinstance(there, PositionSetpoint)
    back = anchor.pose(_level(there.position_ned_m, there.yaw_rad or 0.0))
    assert norm(subtract(back.position_ned_m, point)) < 1e-6
    assert angle_between(back.q_wxyz, quat_from_euler(0.0, 0.0, yaw)) < 1e-6
    flown = anchor.to_local(VelocitySetpoint(point, yaw_rate_rad_s=0.5))
    assert isinstance(flown, VelocitySetpoint)
    assert norm(subtract(anchor.velocity(flown.velocity_ned_m_s), point)) < 1e-6
    assert (flown.yaw_rad, flown.yaw_rate_rad_s) == (None, 0.5)


def test_turn_is_clockwise_from_north() -> None:
    anchor = Anchor.of_poses(local=_level((0, 0, 0), 0.0), world=_level((0, 0, 0), math.pi / 2))
    assert anchor.position((1.0, 0.0, 0.0)) == pytest.approx((0.0, 1.0, 0.0))


def test_an_anchor_of_an_origin_only_shifts() -> None:
    anchor = Anchor((10.0, -5.0, 2.0))
    pose = Pose((1.0, 1.0, -1.0), quat_from_euler(0.1, 0.2, 0.3))
    assert anchor.pose(pose) == Pose((11.0, -4.0, 1.0), pose.q_wxyz)


def test_average_takes_the_last_second_and_goes_round_the_circle() -> None:
    average = PoseAverage(span_s=1.0)
    for number in range(200):
        t_s = number * 0.02
        yaw = math.pi - 0.1 if number % 2 else -math.pi + 0.1
        north = 50.0 if t_s < 2.9 else (0.01 if number % 2 else -0.01)
        average.add(t_s, Pose((north, 0.0, -1.0), quat_from_euler(0.2, 0.1, yaw)))
    mean = average.mean()
    assert mean.position_ned_m == pytest.approx((0.0, 0.0, -1.0), abs=1e-3)
    assert abs(mean.yaw_rad) == pytest.approx(math.pi, abs=1e-2)
    assert average.rate_hz == pytest.approx(50.0, abs=1e-6)


def test_an_average_refuses_poses_that_cannot_be_averaged() -> None:
    average = PoseAverage()
    assert average.rate_hz == 0.0
    with pytest.raises(AnchorError, match="only 0"):
        average.mean()
    for number in range(20):
        average.add(number * 0.05, Pose((number * 0.1, 0.0, 0.0)))
    with pytest.raises(AnchorError, match="moved by"):
        average.mean()
    for number in range(50):
        average.add(2.0 + number * 0.05, Pose((math.nan, 0.0, 0.0)))
    with pytest.raises(AnchorError, match="is not finite"):
        average.mean()


def test_average_starts_anew_when_time_goes_back() -> None:
    average = PoseAverage()
    for number in range(50):
        average.add(100.0 + number * 0.02, Pose((9.0, 0.0, 0.0)))
    for number in range(20):
        average.add(1.0 + number * 0.02, Pose((1.0, 0.0, 0.0)))
    assert average.mean().position_ned_m == pytest.approx((1.0, 0.0, 0.0))
