"""What the parts of the embedded vehicle hand to each other, many hundred times a second.

Named tuples, not dataclasses: they are made 250 times per simulated second, where a frozen
dataclass costs three times as much to build.
"""

from typing import NamedTuple

from worlds.frames import Pose, Vec3
from worlds.jit import F64

Thrusts = tuple[float, float, float, float]
"""Newtons per motor, PX4's quad X order."""

STOPPED: Thrusts = (0.0, 0.0, 0.0, 0.0)


class Motion(NamedTuple):
    """A body's motion state: NED metres and m/s from its place at boot; Euler angles; body rates.

    `specific_force_m_s2` is what an accelerometer feels, body axes.
    """

    position_ned_m: Vec3
    velocity_ned_m_s: Vec3
    euler_rad: Vec3
    rates_rad_s: Vec3
    specific_force_m_s2: Vec3


def motion_of(array: F64) -> Motion:
    """Return the motion in a motion array (see motion_kernel)."""
    n, e, d, vn, ve, vd, roll, pitch, yaw, p, q, r, x, y, z = array.tolist()
    return Motion((n, e, d), (vn, ve, vd), (roll, pitch, yaw), (p, q, r), (x, y, z))


AT_REST = Motion(
    (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -9.80665)
)


class TruthSample(NamedTuple):
    """The vehicle's true state in the world's local frame.

    t_s: run clock. motors_stopped: no motor gives thrust by command. contact: the physical thing
    that it has touched, for good; None while it has touched nothing. rates_frd_rad_s: of the body.
    specific_force_frd_m_s2: what an accelerometer feels. thrusts_n: what each motor gives; STOPPED
    and at rest where nobody said.
    """

    t_s: float
    pose: Pose
    velocity_ned_m_s: Vec3
    on_ground: bool
    motors_stopped: bool
    contact: str | None = None
    rates_frd_rad_s: Vec3 = AT_REST.rates_rad_s
    specific_force_frd_m_s2: Vec3 = AT_REST.specific_force_m_s2
    thrusts_n: Thrusts = STOPPED
