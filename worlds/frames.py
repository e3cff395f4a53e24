"""Frames and rotations: NED metres, body FRD, quaternions wxyz (body to NED), radians.

Small tuples of floats rather than arrays: a rotation is used thousands of times a second
one at a time, where an array costs more than the arithmetic.

Formulas: Diebel, "Representing Attitude" (2006); Euler angles are yaw-pitch-roll (3-2-1).
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

Vec3 = tuple[float, float, float]
Quat = tuple[float, float, float, float]
Matrix3 = NDArray[np.float64]

IDENTITY: Quat = (1.0, 0.0, 0.0, 0.0)


def wrap_pi(angle_rad: float) -> float:
    """Return the angle in [-pi, pi)."""
    wrapped_rad = (angle_rad + math.pi) % (2.0 * math.pi) - math.pi
    # The remainder of a tiny negative number rounds up to the divisor itself.
    return wrapped_rad if wrapped_rad < math.pi else -math.pi


def add(a: Vec3, b: Vec3) -> Vec3:
    """Return the vector a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def subtract(a: Vec3, b: Vec3) -> Vec3:
    """Return the vector a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scale(a: Vec3, factor: float) -> Vec3:
    """Return the vector a * factor."""
    return (a[0] * factor, a[1] * factor, a[2] * factor)


def norm(a: Vec3) -> float:
    """Return the Euclidean length of the vector a."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


def lerp(a: Vec3, b: Vec3, fraction: float) -> Vec3:
    """Return the point at `fraction` of the line from a to b."""
    return (
        a[0] + (b[0] - a[0]) * fraction,
        a[1] + (b[1] - a[1]) * fraction,
        a[2] + (b[2] - a[2]) * fraction,
    )


def ned_from_enu(enu: Vec3) -> Vec3:
    """Return north-east-down of an east-north-up vector; the same swap goes back."""
    return (enu[1], enu[0], -enu[2])


def frd_from_flu(flu: Vec3) -> Vec3:
    """Return forward-right-down of a forward-left-up vector; the same swap goes back."""
    return (flu[0], -flu[1], -flu[2])


def quat_multiply(a: Quat, b: Quat) -> Quat:
    """Return the Hamilton product a b: first the rotation b, then a."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def quat_conjugate(q: Quat) -> Quat:
    """Return the inverse rotation of a unit quaternion."""
    return (q[0], -q[1], -q[2], -q[3])


def quat_normalize(q: Quat) -> Quat:
    """Return the unit quaternion along q. Raises ValueError when q is zero or not finite."""
    length = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if not 1e-12 < length < math.inf:
        raise ValueError(f"quaternion {q} has no direction")
    return (q[0] / length, q[1] / length, q[2] / length, q[3] / length)


def rotate(q: Quat, v: Vec3) -> Vec3:
    """Return v rotated by the unit quaternion q (body to NED for a body's attitude)."""
    w, x, y, z = q
    tx = 2.0 * (y * v[2] - z * v[1])
    ty = 2.0 * (z * v[0] - x * v[2])
    tz = 2.0 * (x * v[1] - y * v[0])
    return (
        v[0] + w * tx + y * tz - z * ty,
        v[1] + w * ty + z * tx - x * tz,
        v[2] + w * tz + x * ty - y * tx,
    )


def quat_from_euler(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quat:
    """Return the attitude of yaw, then pitch, then roll (3-2-1)."""
    cr, sr = math.cos(roll_rad / 2), math.sin(roll_rad / 2)
    cp, sp = math.cos(pitch_rad / 2), math.sin(pitch_rad / 2)
    cy, sy = math.cos(yaw_rad / 2), math.sin(yaw_rad / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def heading_of(q: Quat) -> float:
    """Return an attitude's heading in radians, clockwise from north, in [-pi, pi]."""
    w, x, y, z = q
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def euler_from_quat(q: Quat) -> Vec3:
    """Return (roll, pitch, yaw) in radians; at pitch +-90 degrees roll is set to 0."""
    w, x, y, z = q
    sin_pitch = 2.0 * (w * y - z * x)
    if abs(sin_pitch) > 1.0 - 1e-12:
        return (0.0, math.copysign(math.pi / 2, sin_pitch), wrap_pi(2.0 * math.atan2(z, w)))
    return (
        math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        math.asin(sin_pitch),
        math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )


def matrix_from_quat(q: Quat) -> Matrix3:
    """Return the 3x3 matrix that rotates as q does."""
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quat_from_matrix(matrix: Matrix3) -> Quat:
    """Return the unit quaternion (w >= 0) of a 3x3 rotation matrix (Shepperd's method)."""
    m = [[float(matrix[i, j]) for j in range(3)] for i in range(3)]
    trace = m[0][0] + m[1][1] + m[2][2]
    squares = (trace, m[0][0], m[1][1], m[2][2])
    largest = squares.index(max(squares))
    if largest == 0:
        q = (1 + trace, m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1])
    elif largest == 1:
        q = (m[2][1] - m[1][2], 1 + 2 * m[0][0] - trace, m[1][0] + m[0][1], m[2][0] + m[0][2])
    elif largest == 2:
        q = (m[0][2] - m[2][0], m[1][0] + m[0][1], 1 + 2 * m[1][1] - trace, m[2][1] + m[1][2])
    else:
        q = (m[1][0] - m[0][1], m[2][0] + m[0][2], m[2][1] + m[1][2], 1 + 2 * m[2][2] - trace)
    unit = quat_normalize(q)
    return unit if unit[0] >= 0 else (-unit[0], -unit[1], -unit[2], -unit[3])


def slerp(a: Quat, b: Quat, fraction: float) -> Quat:
    """Return the attitude at `fraction` of the shorter way from a to b (Shoemake 1985)."""
    dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    if dot < 0.0:
        b, dot = (-b[0], -b[1], -b[2], -b[3]), -dot
    if dot > 1.0 - 1e-9:
        wa, wb = 1.0 - fraction, fraction
    else:
        angle = math.acos(dot)
        wa = math.sin((1.0 - fraction) * angle) / math.sin(angle)
        wb = math.sin(fraction * angle) / math.sin(angle)
    return quat_normalize(
        (
            wa * a[0] + wb * b[0],
            wa * a[1] + wb * b[1],
            wa * a[2] + wb * b[2],
            wa * a[3] + wb * b[3],
        )
    )


def angle_between(a: Quat, b: Quat) -> float:
    """Return the angle in radians of the rotation from attitude a to attitude b, in [0, pi]."""
    w, x, y, z = quat_multiply(quat_conjugate(a), b)
    return 2.0 * math.atan2(math.sqrt(x * x + y * y + z * z), abs(w))


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a body is in its parent frame: position in metres (NED) and attitude (FRD to NED)."""

    position_ned_m: Vec3
    q_wxyz: Quat = IDENTITY

    @classmethod
    def of(
        cls,
        north_m: float,
        east_m: float,
        up_m: float,
        *,
        roll_rad: float = 0.0,
        pitch_rad: float = 0.0,
        yaw_rad: float = 0.0,
    ) -> Self:
        """Return the pose that files give as north, east, up and Euler angles."""
        return cls((north_m, east_m, -up_m), quat_from_euler(roll_rad, pitch_rad, yaw_rad))

    @property
    def yaw_rad(self) -> float:
        """Return the pose's heading, clockwise from north, in [-pi, pi]."""
        return heading_of(self.q_wxyz)

    def to_parent(self, point_m: Vec3) -> Vec3:
        """Return a point of this body's frame in the parent frame."""
        return add(self.position_ned_m, rotate(self.q_wxyz, point_m))

    def to_local(self, point_m: Vec3) -> Vec3:
        """Return a point of the parent frame in this body's frame."""
        return rotate(quat_conjugate(self.q_wxyz), subtract(point_m, self.position_ned_m))

    def compose(self, child: "Pose") -> "Pose":
        """Return the pose in the parent frame of a child given in this body's frame."""
        return Pose(self.to_parent(child.position_ned_m), quat_multiply(self.q_wxyz, child.q_wxyz))

    def inverse(self) -> "Pose":
        """Return the parent frame as seen from this body."""
        back = quat_conjugate(self.q_wxyz)
        return Pose(rotate(back, scale(self.position_ned_m, -1.0)), back)

    def interpolate(self, other: "Pose", fraction: float) -> "Pose":
        """Return the pose at `fraction` between two (linear, slerp)."""
        return Pose(
            lerp(self.position_ned_m, other.position_ned_m, fraction),
            slerp(self.q_wxyz, other.q_wxyz, fraction),
        )


AT_ORIGIN = Pose((0.0, 0.0, 0.0))
"""The identity: at the origin of the parent frame, unrotated."""
