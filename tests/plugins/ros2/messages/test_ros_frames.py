"""Frames of ROS and ours: known attitudes, and the same rotation there and back."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.plugins.ros2.messages.ros_frames import (
    attitude_enu,
    attitude_ned,
    body_from_ned,
    enu_from_ned,
    flu_from_frd,
    heading_ned,
    ned_from_level_body,
    optical_in_body,
    sensor_in_body,
)
from wil_campaign.worlds.camera import CameraMount
from wil_campaign.worlds.frames import (
    Pose,
    angle_between,
    heading_of,
    quat_from_euler,
    rotate,
)

ANGLES = st.floats(-math.pi, math.pi)
HALF = math.sqrt(0.5)


@pytest.mark.parametrize(
    ("yaw_deg", "east_north_deg"), [(0.0, 90.0), (90.0, 0.0), (-90.0, 180.0), (180.0, -90.0)]
)
def test_headings_turn_from_clockwise_of_north_to_counterclockwise_of_east(
    yaw_deg: float, east_north_deg: float
) -> None:
    q = attitude_enu(quat_from_euler(0.0, 0.0, math.radians(yaw_deg)))
    difference = math.degrees(heading_of(q)) - east_north_deg
    assert (difference + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-9)


@given(ANGLES, ANGLES, ANGLES)
def test_an_attitude_comes_back(roll: float, pitch: float, yaw: float) -> None:
    q = quat_from_euler(roll, pitch, yaw)
    assert angle_between(attitude_ned(attitude_enu(q)), q) == pytest.approx(0.0, abs=1e-6)


@given(ANGLES, ANGLES, ANGLES)
def test_axes_of_the_body_point_the_same_way_in_both(roll: float, pitch: float, yaw: float) -> None:
    q = quat_from_euler(roll, pitch, yaw)
    for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)):
        there = rotate(attitude_enu(q), flu_from_frd(axis))
        assert there == pytest.approx(enu_from_ned(rotate(q, axis)), abs=1e-9)


def test_a_pitch_up_is_a_pitch_up_of_the_other_sign() -> None:
    """FRD: nose up is positive; FLU: its y axis points left, so nose up is negative."""
    nose_up = attitude_enu(quat_from_euler(0.0, 0.3, math.pi / 2))
    assert rotate(nose_up, (1.0, 0.0, 0.0)) == pytest.approx((math.cos(0.3), 0.0, math.sin(0.3)))


def test_a_setpoint_of_the_body_goes_where_the_vehicle_heads_and_stays_level() -> None:
    tilted = Pose((0.0, 0.0, -1.0), quat_from_euler(0.4, -0.3, math.pi / 2))
    assert ned_from_level_body(tilted, (1.0, 0.5, 0.2)) == pytest.approx((0.5, 1.0, -0.2))


def test_a_velocity_is_seen_from_the_body() -> None:
    east = Pose((0.0, 0.0, 0.0), quat_from_euler(0.0, 0.0, math.pi / 2))
    assert body_from_ned(east, (1.0, 2.0, -3.0)) == pytest.approx((2.0, 1.0, 3.0))


@given(ANGLES)
def test_headings_of_setpoints_come_back(yaw: float) -> None:
    q = attitude_enu(quat_from_euler(0.0, 0.0, yaw))
    assert math.cos(heading_ned(q) - yaw) == pytest.approx(1.0)


def test_a_quaternion_of_length_zero_has_no_heading() -> None:
    with pytest.raises(ValueError, match="no direction"):
        heading_ned((0.0, 0.0, 0.0, 0.0))


def test_the_optical_frame_of_a_camera_that_looks_forward() -> None:
    position, turned = optical_in_body(Pose((0.1, 0.2, 0.3)))
    assert position == pytest.approx((0.1, -0.2, -0.3))
    assert rotate(turned, (0.0, 0.0, 1.0)) == pytest.approx((1.0, 0.0, 0.0))  # it looks forward
    assert rotate(turned, (1.0, 0.0, 0.0)) == pytest.approx((0.0, -1.0, 0.0))  # right


def test_a_gimbal_stays_level_in_a_tilted_body() -> None:
    tilted = Pose((0.0, 0.0, 0.0), quat_from_euler(0.2, 0.3, 0.0))
    _, turned = optical_in_body(CameraMount(stabilized=True).in_body(tilted))
    ahead = rotate(attitude_enu(tilted.q_wxyz), rotate(turned, (0.0, 0.0, 1.0)))
    assert ahead == pytest.approx((0.0, 1.0, 0.0), abs=1e-9)


def test_a_sensor_that_looks_down() -> None:
    down = Pose((0.0, 0.0, 0.1), quat_from_euler(0.0, -math.pi / 2, 0.0))
    position, turned = sensor_in_body(down)
    assert position == pytest.approx((0.0, 0.0, -0.1))
    assert rotate(turned, (1.0, 0.0, 0.0)) == pytest.approx((0.0, 0.0, -1.0), abs=1e-9)
