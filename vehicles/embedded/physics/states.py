"""The states that parts of the embedded vehicle exchange: motion, truth, thrusts.

Named tuples, not dataclasses: they are created 250 times per simulated second, where a frozen
dataclass costs three times as much.
"""

from typing import NamedTuple

from wil_campaign.worlds.frames import Pose, Vec3
from wil_campaign.worlds.jit import F64

Thrusts = tuple[float, float, float, float]
"""Newtons per motor, PX4's quad X order."""

STOPPED: Thrusts = (0.0, 0.0, 0.0, 0.0)


class Motion(NamedTuple):
    """A body's motion state: NED metres and m/s from its place at boot; Euler angles; body rates.

    `specific_force_m_s2` is what an accelerometer measures, body axes.
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

    t_s: run clock. motors_stopped: all commanded thrusts are zero. contact: the first object that
    it has touched, kept from then on; None while it has touched nothing. rates_frd_rad_s: of the
    body. specific_force_frd_m_s2: what an accelerometer measures. thrusts_n: of each motor. The
    last three default to rest.
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
