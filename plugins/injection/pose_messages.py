"""Encodes poses as MAVLink messages for an autopilot's estimator or precision landing; pure.

Poses are in the autopilot's own local NED frame: `poses.anchor.Anchor` converts them from the
world's. They are sent only if a campaign names them: the estimator of a flying vehicle uses them.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.injection.range_messages import message_microseconds
from wil_campaign.vehicles.readings import PoseReading
from wil_campaign.worlds.frames import Pose, Vec3, euler_from_quat, norm, quat_conjugate, rotate

_DIAGONAL = (0, 6, 11, 15, 18, 20)
"""Indices of the diagonal of a 6 x 6 matrix in its upper triangle, written row by row."""


@dataclass(frozen=True, slots=True)
class PoseSpread:
    """The spread of a pose in messages, one standard deviation: metres, radians, m/s."""

    position_m: float
    attitude_rad: float
    velocity_m_s: float = 0.1


def vision_position_estimate(reading: PoseReading, *, spread: PoseSpread | None = None) -> Any:
    """Return a pose as VISION_POSITION_ESTIMATE (102): NED metres, Euler angles in radians.

    spread: None leaves it to the autopilot's parameters. To be sent at 30 Hz or more.
    """
    roll, pitch, yaw = euler_from_quat(reading.pose.q_wxyz)
    return mavlink.MAVLink_vision_position_estimate_message(
        message_microseconds(reading.t_s),
        *reading.pose.position_ned_m,
        roll,
        pitch,
        yaw,
        covariance=_covariance(spread),
    )


def odometry_message(
    reading: PoseReading, *, autopilot: str, spread: PoseSpread | None = None
) -> Any:
    """Return a pose and velocity as ODOMETRY (331).

    Child frame BODY_FRD. ArduPilot accepts only frame LOCAL_FRD, with forward as north; for PX4
    LOCAL_FRD is a frame of unknown heading, so it gets LOCAL_NED. The numbers are the same. Of
    motion capture, too, it says "vision": PX4's EKF2 takes no other kind of estimator
    (mavlink_receiver.cpp gives MAV_ESTIMATOR_TYPE_MOCAP to a topic that only LPE reads). Raises
    ValueError without a velocity for ArduPilot, which would use the field anyway.
    """
    velocity = reading.velocity_ned_m_s
    if velocity is None and autopilot == "ardupilot":
        raise ValueError("ArduPilot's ODOMETRY needs a velocity: send VISION_POSITION_ESTIMATE")
    unknown = (math.nan,) * 3
    q = reading.pose.q_wxyz
    velocity_frd = rotate(quat_conjugate(q), velocity) if velocity is not None else unknown
    is_px4 = autopilot == "px4"
    return mavlink.MAVLink_odometry_message(
        message_microseconds(reading.t_s),
        mavlink.MAV_FRAME_LOCAL_NED if is_px4 else mavlink.MAV_FRAME_LOCAL_FRD,
        mavlink.MAV_FRAME_BODY_FRD,
        *reading.pose.position_ned_m,
        q,
        *velocity_frd,
        *unknown,
        pose_covariance=_covariance(spread),
        velocity_covariance=_velocity_covariance(spread),
        reset_counter=0,
        estimator_type=mavlink.MAV_ESTIMATOR_TYPE_VISION,
        quality=100,
    )


def landing_target(
    t_s: float, *, target_ned_m: Vec3, body: Pose, autopilot: str, size_m: float = 0.0
) -> Any:
    """Return a landing target as LANDING_TARGET (149), with its position.

    target_ned_m, body: in the autopilot's local NED frame. ArduPilot uses BODY_FRD and a distance,
    PX4 LOCAL_NED; both get the angles of a camera that looks down (x right, y back). size_m: width
    of the target, for its angular size.
    """
    target_frd_m = body.to_local(target_ned_m)
    distance_m = norm(target_frd_m)
    angle_rad = 2.0 * math.atan2(size_m / 2.0, distance_m) if distance_m > 0.0 else 0.0
    is_px4 = autopilot == "px4"
    x, y, z = target_ned_m if is_px4 else target_frd_m
    return mavlink.MAVLink_landing_target_message(
        time_usec=message_microseconds(t_s),
        target_num=0,
        frame=mavlink.MAV_FRAME_LOCAL_NED if is_px4 else mavlink.MAV_FRAME_BODY_FRD,
        angle_x=math.atan2(target_frd_m[1], target_frd_m[2]),
        angle_y=math.atan2(-target_frd_m[0], target_frd_m[2]),
        distance=distance_m,
        size_x=angle_rad,
        size_y=angle_rad,
        x=x,
        y=y,
        z=z,
        q=(1.0, 0.0, 0.0, 0.0),
        type=mavlink.LANDING_TARGET_TYPE_VISION_FIDUCIAL,
        position_valid=1,
    )


def _covariance(spread: PoseSpread | None) -> Sequence[float]:
    """Return a pose message's covariance: x, y, z, roll, pitch, yaw; NaN first where unknown."""
    if spread is None:
        return [math.nan, *[0.0] * 20]
    return _diagonal([spread.position_m] * 3 + [spread.attitude_rad] * 3)


def _velocity_covariance(spread: PoseSpread | None) -> Sequence[float]:
    """Return a pose message's covariance of velocities; NaN first where unknown."""
    if spread is None:
        return [math.nan, *[0.0] * 20]
    return _diagonal([spread.velocity_m_s] * 3 + [0.0] * 3)


def _diagonal(deviations: list[float]) -> list[float]:
    """Return the upper triangle of a diagonal covariance for a pose message."""
    triangle = [0.0] * 21
    for place, deviation in zip(_DIAGONAL, deviations, strict=True):
        triangle[place] = deviation * deviation
    return triangle
