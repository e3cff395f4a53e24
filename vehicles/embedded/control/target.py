"""What a control law is to fly, and how its inputs and outputs lie in arrays."""

from typing import NamedTuple

from worlds.frames import Vec3


class Target(NamedTuple):
    """A control law's target, NED, the estimator's frame.

    position_ned_m: per axis, None where only the velocity counts. velocity_ned_m_s: the velocity,
    or what is added to the one that position asks for. yaw_rad: None to turn at yaw_rate_rad_s.
    speed_m_s: limits (horizontal, up, down) of the velocity that results. direct: PX4's law takes
    the target as its setpoint, as OFFBOARD does, rather than a trajectory towards it.
    """

    position_ned_m: tuple[float | None, float | None, float | None]
    velocity_ned_m_s: Vec3 = (0.0, 0.0, 0.0)
    yaw_rad: float | None = None
    yaw_rate_rad_s: float = 0.0
    speed_m_s: Vec3 = (5.0, 3.0, 1.5)
    direct: bool = False
