"""Setpoints of messages: twists, PoseStamped, MultiDOFJointTrajectory, TrajectorySetpoint."""

import math
import struct
from collections.abc import Callable, Mapping
from typing import Any

from wil_campaign.plugins.ros2.messages.ros_frames import (
    enu_from_ned,
    heading_ned,
    ned_from_level_body,
)
from wil_campaign.plugins.ros2.messages.ros_messages import (
    BODY_FRAME,
    ODOMETRY_FRAME,
    PLAIN_TWIST,
    POSE,
    TRAJECTORY,
    TRAJECTORY_SETPOINT,
    TWIST,
    WORLD_FRAME,
)
from wil_campaign.vehicles.setpoints import PositionSetpoint, Setpoint, VelocitySetpoint
from wil_campaign.worlds.frames import Pose, Vec3, wrap_pi

_NS = 1_000_000_000
_NS_IN_US = 1_000
_P_LEVEL, _P_UP = 0.95, 1.0
"""Of a position's error to a velocity, 1/s: PX4's MPC_XY_P and MPC_Z_P."""
_LEVEL_M_S, _UP_M_S, _DOWN_M_S = 12.0, 3.0, 1.5
"""Most of such a velocity: MPC_XY_VEL_MAX, MPC_Z_VEL_MAX_UP and MPC_Z_VEL_MAX_DN."""
_WORLD_FRAMES = ("", WORLD_FRAME, ODOMETRY_FRAME)
_BODY_FRAMES = (BODY_FRAME, "base_footprint", "base_link_stabilized")


class BadSetpointError(Exception):
    """A message is no setpoint for a vehicle; says what of it, and the remedy."""


def setpoint_stamp_of(cdr: bytes, kind: str = TWIST) -> int:
    """Return the stamp, in nanoseconds, of the CDR of a setpoint: of its Header, or PX4's.

    0 for a message that has none.
    """
    if len(cdr) < 12 or kind == PLAIN_TWIST:
        return 0
    order = "<" if cdr[1] & 1 else ">"
    if kind == TRAJECTORY_SETPOINT:
        return int(struct.unpack_from(f"{order}Q", cdr, 4)[0]) * _NS_IN_US
    seconds, nanoseconds = struct.unpack_from(f"{order}iI", cdr, 4)
    return int(seconds) * _NS + int(nanoseconds)


def setpoint_stamp_in(kind: str, stamp_ns: int) -> int:
    """Return a stamp as a setpoint can repeat it: PX4's have microseconds."""
    return stamp_ns // _NS_IN_US * _NS_IN_US if kind == TRAJECTORY_SETPOINT else stamp_ns


def setpoint_of(message: Any, kind: str, body: Pose) -> Setpoint:
    """Return the setpoint of a message. body: the vehicle's pose. Raises BadSetpointError."""
    return _READERS[kind](message, body)


def _of_twist(message: Any, body: Pose) -> Setpoint:
    """Return the velocity of a TwistStamped: of the world, or of the level body's axes."""
    return _velocity(message.twist, message.header.frame_id, body)


def _of_plain_twist(message: Any, body: Pose) -> Setpoint:
    """Return the velocity of a Twist, which says no frame: of the level body's axes."""
    return _velocity(message, BODY_FRAME, body)


def _velocity(twist: Any, frame: str, body: Pose) -> VelocitySetpoint:
    linear = _vector("linear", twist.linear)
    turn = _number("angular.z", twist.angular.z)
    if frame in _WORLD_FRAMES:
        velocity = enu_from_ned(linear)
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


def _of_px4(message: Any, body: Pose) -> Setpoint:
    """Return the setpoint of a TrajectorySetpoint, NED, as PX4 takes it: NaN is not controlled.

    An axis with a position flies to it, with a velocity at it. A mixture of both is a velocity,
    which closes the error of a position as PX4's controller does. The velocity of an axis that has
    both, and accelerations, feed forward and are left out.
    """
    position, velocity = message.position, message.velocity
    yaw, turn = _controlled("yaw", message.yaw), _controlled("yawspeed", message.yawspeed)
    places = [_controlled(f"position[{i}]", float(position[i])) for i in range(3)]
    speeds = [_controlled(f"velocity[{i}]", float(velocity[i])) for i in range(3)]
    for axis, (place, speed) in enumerate(zip(places, speeds, strict=True)):
        if place is None and speed is None:
            raise BadSetpointError(
                f"has NaN as both position[{axis}] and velocity[{axis}]: give one of them, for "
                "accelerations are not flown"
            )
    heading = None if yaw is None else wrap_pi(yaw)
    north, east, down = places
    if north is not None and east is not None and down is not None:
        return PositionSetpoint((north, east, down), heading)
    at_north, at_east, at_down = body.position_ned_m
    found = (
        _axis_speed(speeds[0], north, at_north, _P_LEVEL, (_LEVEL_M_S, _LEVEL_M_S)),
        _axis_speed(speeds[1], east, at_east, _P_LEVEL, (_LEVEL_M_S, _LEVEL_M_S)),
        _axis_speed(speeds[2], down, at_down, _P_UP, (_UP_M_S, _DOWN_M_S)),
    )
    return VelocitySetpoint(found, heading, turn if heading is None else None)


def _axis_speed(
    speed: float | None, place: float | None, at: float, gain: float, most: tuple[float, float]
) -> float:
    """Return the velocity of an axis, to its place if it has one. most: backward and forward."""
    if place is None:
        return 0.0 if speed is None else speed
    return min(max(gain * (place - at), -most[0]), most[1])


def _controlled(name: str, value: float) -> float | None:
    """Return a value of PX4, None for NaN. Raises BadSetpointError for one that is infinite."""
    return None if math.isnan(value) else _number(name, value)


def _position(place: Any, turned: Any) -> PositionSetpoint:
    position = enu_from_ned(_vector("position", place))
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
    PLAIN_TWIST: _of_plain_twist,
    POSE: _of_pose,
    TRAJECTORY: _of_trajectory,
    TRAJECTORY_SETPOINT: _of_px4,
}
