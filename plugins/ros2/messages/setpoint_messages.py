"""Setpoints of ROS 2 messages: TwistStamped, PoseStamped, MultiDOFJointTrajectory."""

import math
import struct
from collections.abc import Callable, Mapping
from typing import Any

from wil_campaign.plugins.ros2.messages.ros_frames import enu, heading_ned, ned_from_level_body
from wil_campaign.plugins.ros2.messages.ros_messages import (
    BODY_FRAME,
    ODOMETRY_FRAME,
    POSE,
    TRAJECTORY,
    TWIST,
    WORLD_FRAME,
)
from wil_campaign.vehicles.setpoints import PositionSetpoint, Setpoint, VelocitySetpoint
from wil_campaign.worlds.frames import Pose, Vec3

_NS = 1_000_000_000
_WORLD_FRAMES = ("", WORLD_FRAME, ODOMETRY_FRAME)
_BODY_FRAMES = (BODY_FRAME, "base_footprint", "base_link_stabilized")


class BadSetpointError(Exception):
    """A message is no setpoint for a vehicle; says what of it, and the remedy."""


def stamp_of(cdr: bytes) -> int:
    """Return the stamp, in nanoseconds, of the CDR of a message that begins with a Header."""
    if len(cdr) < 12:
        return 0
    order = "<" if cdr[1] & 1 else ">"
    seconds, nanoseconds = struct.unpack_from(f"{order}iI", cdr, 4)
    return int(seconds) * _NS + int(nanoseconds)


def setpoint_of(message: Any, kind: str, body: Pose) -> Setpoint:
    """Return the setpoint of a message. body: the vehicle's pose. Raises BadSetpointError."""
    return _READERS[kind](message, body)


def _of_twist(message: Any, body: Pose) -> Setpoint:
    """Return the velocity of a TwistStamped: of the world, or of the level body's axes."""
    return _velocity(message.twist, message.header.frame_id, body)


def _velocity(twist: Any, frame: str, body: Pose) -> VelocitySetpoint:
    linear = _vector("linear", twist.linear)
    turn = _number("angular.z", twist.angular.z)
    if frame in _WORLD_FRAMES:
        velocity = enu(linear)
    elif frame in _BODY_FRAMES:
        velocity = ned_from_level_body(body, linear)
    else:
        raise BadSetpointError(f"is in the frame '{frame}': use {WORLD_FRAME} or {BODY_FRAME}")
    # Counter-clockwise from above is positive there, clockwise here.
    return VelocitySetpoint(velocity, yaw_rate_rad_s=-turn if turn else None)


def _of_pose(message: Any, body: Pose) -> Setpoint:
    """Return the position and heading of a PoseStamped in the world."""
    del body
    _require_world(message.header.frame_id)
    return _position(message.pose.position, message.pose.orientation)


def _of_trajectory(message: Any, body: Pose) -> Setpoint:
    """Return the setpoint of a trajectory's first point: its position, else its velocity."""
    if not message.points:
        raise BadSetpointError("has no points")
    point, frame = message.points[0], message.header.frame_id
    if point.transforms:
        _require_world(frame)
        return _position(point.transforms[0].translation, point.transforms[0].rotation)
    if point.velocities:
        return _velocity(point.velocities[0], frame, body)
    raise BadSetpointError("has a first point with neither transforms nor velocities")


def _position(place: Any, turned: Any) -> PositionSetpoint:
    position = enu(_vector("position", place))
    quaternion = tuple(_number(f"orientation.{axis}", getattr(turned, axis)) for axis in "wxyz")
    w, x, y, z = quaternion
    try:
        return PositionSetpoint(position, heading_ned((w, x, y, z)))
    except ValueError:
        raise BadSetpointError("has an orientation of length 0: its w is 1 for east") from None


def _require_world(frame: str) -> None:
    if frame not in _WORLD_FRAMES:
        raise BadSetpointError(f"is in the frame '{frame}': positions are in {WORLD_FRAME}")


def _vector(name: str, value: Any) -> Vec3:
    x, y, z = (_number(f"{name}.{axis}", getattr(value, axis)) for axis in "xyz")
    return (x, y, z)


def _number(name: str, value: float) -> float:
    if not math.isfinite(value):
        raise BadSetpointError(f"is not finite: {name} = {value}")
    return float(value)


_READERS: Mapping[str, Callable[[Any, Pose], Setpoint]] = {
    TWIST: _of_twist,
    POSE: _of_pose,
    TRAJECTORY: _of_trajectory,
}
