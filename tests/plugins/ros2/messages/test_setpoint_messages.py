"""Setpoints of messages: frames, headings, and what is none."""

import math
from typing import Any

import numpy as np
import pytest

from tests.plugins.ros2.px4.definitions import DEFINITIONS
from wil_campaign.plugins.ros2.messages.ros_messages import (
    PLAIN_TWIST,
    POSE,
    TRAJECTORY,
    TRAJECTORY_SETPOINT,
    TWIST,
)
from wil_campaign.plugins.ros2.messages.ros_types import RosTypes, ros_types
from wil_campaign.plugins.ros2.messages.setpoint_messages import (
    BadSetpointError,
    setpoint_of,
    setpoint_stamp_in,
    setpoint_stamp_of,
)
from wil_campaign.vehicles.setpoints import PositionSetpoint, VelocitySetpoint
from wil_campaign.worlds.frames import Pose, quat_from_euler

TYPES = ros_types("jazzy")
NORTH = Pose((0.0, 0.0, -1.0))
EAST = Pose((0.0, 0.0, -1.0), quat_from_euler(0.1, 0.2, math.pi / 2))


def of(name: str, *fields: object) -> Any:
    return TYPES.cls(name)(*fields)


def header(frame: str, sec: int = 5) -> Any:
    return of("std_msgs/msg/Header", of("builtin_interfaces/msg/Time", sec, 250), frame)


def vector(*xyz: float, of_type: str = "Vector3") -> Any:
    return of(f"geometry_msgs/msg/{of_type}", *xyz)


def turned(w: float, z: float) -> Any:
    return of("geometry_msgs/msg/Quaternion", 0.0, 0.0, z, w)


def twist(frame: str, *linear: float, turn: float = 0.0) -> Any:
    body = of("geometry_msgs/msg/Twist", vector(*linear), vector(0.0, 0.0, turn))
    return of(TWIST, header(frame), body)


def pose(frame: str, *place: float, w: float = 1.0, z: float = 0.0) -> Any:
    at = of("geometry_msgs/msg/Pose", vector(*place, of_type="Point"), turned(w, z))
    return of(POSE, header(frame), at)


def trajectory(frame: str, transforms: list[Any], velocities: list[Any]) -> Any:
    none = of("builtin_interfaces/msg/Duration", 0, 0)
    kind = "trajectory_msgs/msg/MultiDOFJointTrajectoryPoint"
    return of(TRAJECTORY, header(frame), [], [of(kind, transforms, velocities, [], none)])


@pytest.mark.parametrize("frame", ["", "map", "odom"])
def test_a_velocity_of_the_world(frame: str) -> None:
    found = setpoint_of(twist(frame, 1.0, 2.0, 3.0, turn=0.5), TWIST, EAST)
    assert found == VelocitySetpoint((2.0, 1.0, -3.0), yaw_rate_rad_s=-0.5)


def test_a_velocity_of_the_body_follows_its_heading() -> None:
    found = setpoint_of(twist("base_link", 1.0, 0.5, 0.2), TWIST, EAST)
    assert isinstance(found, VelocitySetpoint)
    assert found.velocity_ned_m_s == pytest.approx((0.5, 1.0, -0.2))
    assert found.yaw_rate_rad_s is None  # the heading stays


def test_a_position_with_its_heading() -> None:
    found = setpoint_of(pose("map", 1.0, 2.0, 3.0), POSE, NORTH)
    assert isinstance(found, PositionSetpoint)
    assert found.position_ned_m == (2.0, 1.0, -3.0)
    assert found.yaw_rad == pytest.approx(math.pi / 2)  # w = 1 looks east


def test_the_first_point_of_a_trajectory() -> None:
    at = of("geometry_msgs/msg/Transform", vector(1.0, 2.0, 3.0), turned(1.0, 0.0))
    moves = of("geometry_msgs/msg/Twist", vector(1.0, 0.0, 0.0), vector(0.0, 0.0, 0.0))
    found = setpoint_of(trajectory("map", [at], [moves]), TRAJECTORY, NORTH)
    assert isinstance(found, PositionSetpoint)
    assert found.position_ned_m == (2.0, 1.0, -3.0)
    moved = setpoint_of(trajectory("base_link", [], [moves]), TRAJECTORY, NORTH)
    assert moved == VelocitySetpoint((1.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("message", "kind", "text"),
    [
        (twist("map", float("nan"), 0.0, 0.0), TWIST, "is not finite: linear.x = nan"),
        (twist("map", 0.0, 0.0, 0.0, turn=math.inf), TWIST, "is not finite: angular.z = inf"),
        (twist("camera", 0.0, 0.0, 0.0), TWIST, "is in the frame 'camera': use map or base_link"),
        (pose("base_link", 0.0, 0.0, 0.0), POSE, "positions are in map"),
        (pose("map", 0.0, 0.0, 0.0, w=0.0), POSE, "orientation of length 0"),
        (pose("map", 0.0, -math.inf, 0.0), POSE, "is not finite: position.y = -inf"),
        (of(TRAJECTORY, header("map"), [], []), TRAJECTORY, "has no points"),
        (trajectory("map", [], []), TRAJECTORY, "neither transforms nor velocities"),
    ],
)
def test_a_message_that_is_no_setpoint_is_refused(message: Any, kind: str, text: str) -> None:
    with pytest.raises(BadSetpointError, match=text):
        setpoint_of(message, kind, NORTH)


def test_the_stamp_is_read_without_the_rest() -> None:
    data = TYPES.serialize(twist("map", 0.0, 0.0, 0.0), TWIST)
    assert setpoint_stamp_of(data) == 5_000_000_250
    big_endian = b"\0\0\0\0" + np.array([5, 250], ">u4").tobytes()
    assert setpoint_stamp_of(big_endian) == 5_000_000_250
    assert setpoint_stamp_of(b"\0\1") == 0


def test_a_twist_without_a_stamp_is_of_the_body() -> None:
    body = of(PLAIN_TWIST, vector(1.0, 2.0, 3.0), vector(0.0, 0.0, 0.5))
    found = setpoint_of(body, PLAIN_TWIST, EAST)
    assert isinstance(found, VelocitySetpoint)
    assert found.velocity_ned_m_s == pytest.approx((2.0, 1.0, -3.0))
    assert found.yaw_rate_rad_s == -0.5
    assert setpoint_stamp_of(TYPES.serialize(body, PLAIN_TWIST), PLAIN_TWIST) == 0


PX4 = RosTypes("jazzy", {TRAJECTORY_SETPOINT: DEFINITIONS["TrajectorySetpoint"]})
NAN = float("nan")


def px4(position: tuple[float, ...], velocity: tuple[float, ...], *turns: float) -> Any:
    """Return a TrajectorySetpoint. turns: yaw and yawspeed."""
    yaw, yawspeed = turns or (NAN, NAN)
    floats = (np.array(one, np.float32) for one in (position, velocity))
    return PX4.cls(TRAJECTORY_SETPOINT)(3_000_007, *floats, yaw, yawspeed)


@pytest.mark.parametrize(
    ("message", "setpoint"),
    [
        (px4((1, 2, -3), (NAN,) * 3), PositionSetpoint((1, 2, -3))),
        (px4((1, 2, -3), (0.5, 0, 0), 7.0, 0.1), PositionSetpoint((1, 2, -3), 7 - 2 * math.pi)),
        (px4((NAN,) * 3, (1, 2, -3), NAN, 0.5), VelocitySetpoint((1, 2, -3), yaw_rate_rad_s=0.5)),
        (px4((NAN,) * 3, (1, 2, -3), 0.5, 0.5), VelocitySetpoint((1, 2, -3), yaw_rad=0.5)),
        # It is 1 m above the origin, and climbs by the error to 3 m.
        (px4((NAN, NAN, -3), (1, 2, NAN)), VelocitySetpoint((1, 2, -2))),
        (px4((NAN, NAN, -30), (1, 2, NAN)), VelocitySetpoint((1, 2, -3))),
        (px4((NAN, NAN, 30), (1, 2, NAN)), VelocitySetpoint((1, 2, 1.5))),
        (px4((-2, NAN, NAN), (NAN, 0, 0)), VelocitySetpoint((-1.9, 0, 0))),
    ],
)
def test_a_setpoint_of_px4(message: Any, setpoint: object) -> None:
    assert setpoint_of(message, TRAJECTORY_SETPOINT, NORTH) == setpoint


@pytest.mark.parametrize(
    ("message", "fault"),
    [
        (px4((1, 2, NAN), (NAN,) * 3), r"NaN as both position\[2\] and velocity\[2\]"),
        (px4((1, 2, math.inf), (NAN,) * 3), r"is not finite: position\[2\] = inf"),
        (px4((1, 2, -3), (NAN,) * 3, math.inf, 0), "is not finite: yaw = inf"),
    ],
)
def test_a_setpoint_of_px4_that_is_none_is_named(message: Any, fault: str) -> None:
    with pytest.raises(BadSetpointError, match=fault):
        setpoint_of(message, TRAJECTORY_SETPOINT, NORTH)


def test_a_stamp_of_px4_has_microseconds() -> None:
    cdr = PX4.serialize(px4((1, 2, -3), (NAN,) * 3), TRAJECTORY_SETPOINT)
    assert setpoint_stamp_of(cdr, TRAJECTORY_SETPOINT) == 3_000_007_000
    assert setpoint_stamp_in(TRAJECTORY_SETPOINT, 3_000_007_999) == 3_000_007_000
    assert setpoint_stamp_in(TWIST, 3_000_007_999) == 3_000_007_999
