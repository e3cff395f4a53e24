"""The motion that parts of the embedded vehicle exchange.

Named tuples, not dataclasses: they are created 250 times per simulated second, where a frozen
dataclass costs three times as much.
"""

from typing import NamedTuple

from wil_campaign.worlds.frames import Vec3
from wil_campaign.worlds.jit import F64


class BodyMotion(NamedTuple):
    """A body's motion state: NED metres and m/s from its place at boot; Euler angles; body rates.

    `specific_force_m_s2` is what an accelerometer measures, body axes.
    """

    position_ned_m: Vec3
    velocity_ned_m_s: Vec3
    euler_rad: Vec3
    rates_rad_s: Vec3
    specific_force_m_s2: Vec3


def motion_of_array(array: F64) -> BodyMotion:
    """Return the motion in a motion array (see motion_kernel)."""
    n, e, d, vn, ve, vd, roll, pitch, yaw, p, q, r, x, y, z = array.tolist()
    return BodyMotion((n, e, d), (vn, ve, vd), (roll, pitch, yaw), (p, q, r), (x, y, z))
