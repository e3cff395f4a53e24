"""The true state of a vehicle at one moment, as sensors sample it."""

import math
from dataclasses import dataclass

from wil_campaign.worlds.frames import Pose, Vec3

THRUST_PER_SPEED_SQUARED_N_S2 = 5.57e-6
"""Newtons of one rotor per (rad/s)^2: AscTec Hummingbird, 6.11e-8 N/rpm^2 (Michael, Mellinger,
Lindsey and Kumar, "The GRASP Multiple Micro-UAV Testbed", 2010), the source of the airframe."""


@dataclass(frozen=True, slots=True)
class Truth:
    """The true motion of a vehicle, as sensors sample it.

    pose: body (FRD) in the world's local frame (NED metres). velocity_ned_m_s: over ground.
    rates_frd_rad_s: angular velocity in body axes. specific_force_frd_m_s2: what an
    accelerometer in the origin measures, (0, 0, -9.81) at rest. motor_speeds_rad_s: of each rotor,
    zero or more; empty when not known.
    """

    pose: Pose
    velocity_ned_m_s: Vec3 = (0.0, 0.0, 0.0)
    rates_frd_rad_s: Vec3 = (0.0, 0.0, 0.0)
    specific_force_frd_m_s2: Vec3 = (0.0, 0.0, -9.80665)
    motor_speeds_rad_s: tuple[float, ...] = ()


def motor_speeds(thrusts_n: tuple[float, ...]) -> tuple[float, ...]:
    """Return the true rotor speeds in rad/s of these thrusts, zero or more newtons each."""
    return tuple(
        math.sqrt(max(0.0, thrust) / THRUST_PER_SPEED_SQUARED_N_S2) for thrust in thrusts_n
    )
