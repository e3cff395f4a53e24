"""The true state of a vehicle, as a simulation knows it.

A named tuple, not a dataclass: it is created 250 times per simulated second, where a frozen
dataclass costs three times as much.
"""

from typing import NamedTuple

from wil_campaign.worlds.frames import Pose, Vec3

Thrusts = tuple[float, float, float, float]
"""Newtons per motor, PX4's quad X order."""

STOPPED: Thrusts = (0.0, 0.0, 0.0, 0.0)


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
    rates_frd_rad_s: Vec3 = (0.0, 0.0, 0.0)
    specific_force_frd_m_s2: Vec3 = (0.0, 0.0, -9.80665)
    thrusts_n: Thrusts = STOPPED
