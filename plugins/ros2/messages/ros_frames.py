"""Frames of ROS (REP 103, 105) and ours: ENU and FLU, NED and FRD; quaternions wxyz.

`map` is the world's local frame as east, north, up; `base_link` the body as forward, left, up; an
optical frame is right, down, forward.
"""

import math

from wil_campaign.worlds.frames import (
    Pose,
    Quat,
    Vec3,
    frd_from_flu,
    heading_of,
    ned_from_enu,
    quat_conjugate,
    quat_multiply,
    quat_normalize,
    rotate,
    wrap_pi,
)

_HALF = math.sqrt(0.5)
_ENU_NED: Quat = (0.0, _HALF, _HALF, 0.0)
"""The half turn about the line between north and east, which swaps them and turns down up."""
_FLU_FRD: Quat = (0.0, 1.0, 0.0, 0.0)
"""The half turn about forward; the same goes back."""
_FRD_OPTICAL: Quat = (0.5, 0.5, 0.5, 0.5)
"""From right, down, forward to forward, right, down."""


def enu_from_ned(ned: Vec3) -> Vec3:
    """Return east-north-up of a north-east-down vector."""
    return ned_from_enu(ned)


def flu_from_frd(frd: Vec3) -> Vec3:
    """Return forward-left-up of a forward-right-down vector."""
    return frd_from_flu(frd)


def attitude_enu(q_wxyz: Quat) -> Quat:
    """Return the attitude of the FLU body in ENU of the attitude of the FRD body in NED."""
    return _positive(quat_multiply(quat_multiply(_ENU_NED, q_wxyz), _FLU_FRD))


def attitude_ned(q_wxyz: Quat) -> Quat:
    """Return the attitude of the FRD body in NED of the attitude of the FLU body in ENU.

    Raises ValueError for a quaternion without a direction.
    """
    unit = quat_normalize(q_wxyz)
    return _positive(quat_multiply(quat_multiply(quat_conjugate(_ENU_NED), unit), _FLU_FRD))


def heading_ned(q_wxyz: Quat) -> float:
    """Return the heading, clockwise from north in radians, of an attitude in ENU.

    Raises ValueError for a quaternion without a direction.
    """
    return wrap_pi(heading_of(attitude_ned(q_wxyz)))


def body_from_ned(pose: Pose, velocity_ned_m_s: Vec3) -> Vec3:
    """Return a velocity in the FLU axes of a body of that pose."""
    return flu_from_frd(rotate(quat_conjugate(pose.q_wxyz), velocity_ned_m_s))


def ned_from_level_body(pose: Pose, velocity_flu_m_s: Vec3) -> Vec3:
    """Return the NED velocity of one in level axes that head as a body does: forward, left, up."""
    level = Pose.of(0.0, 0.0, 0.0, yaw_rad=pose.yaw_rad)
    return rotate(level.q_wxyz, frd_from_flu(velocity_flu_m_s))


def sensor_in_body(mount: Pose) -> tuple[Vec3, Quat]:
    """Return position and attitude, FLU in FLU, of a sensor whose mount is given in FRD."""
    turned = quat_multiply(quat_multiply(_FLU_FRD, mount.q_wxyz), _FLU_FRD)
    return flu_from_frd(mount.position_ned_m), _positive(turned)


def optical_in_body(mount: Pose) -> tuple[Vec3, Quat]:
    """Return position and attitude, in FLU, of a camera's optical frame; its mount is in FRD."""
    turned = quat_multiply(quat_multiply(_FLU_FRD, mount.q_wxyz), _FRD_OPTICAL)
    return flu_from_frd(mount.position_ned_m), _positive(turned)


def _positive(q: Quat) -> Quat:
    """Return the same rotation with w that is not negative."""
    return q if q[0] >= 0 else (-q[0], -q[1], -q[2], -q[3])
