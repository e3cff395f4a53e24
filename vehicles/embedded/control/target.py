"""The target of a control law: position, velocity, heading and speed limits."""

from typing import NamedTuple

from wil_campaign.worlds.frames import Vec3


class ControlTarget(NamedTuple):
    """A control law's target, NED, the estimator's frame.

    position_ned_m: per axis, None where only the velocity counts. velocity_ned_m_s: the velocity,
    or the feed-forward that is added to the position controller's. yaw_rad: None to turn at
    yaw_rate_rad_s. speed_m_s: limits (horizontal, up, down) of the resulting velocity. direct:
    PX4's law uses the target as its setpoint, as OFFBOARD does, not a trajectory towards it.
    """

    position_ned_m: tuple[float | None, float | None, float | None]
    velocity_ned_m_s: Vec3 = (0.0, 0.0, 0.0)
    yaw_rad: float | None = None
    yaw_rate_rad_s: float = 0.0
    speed_m_s: Vec3 = (5.0, 3.0, 1.5)
    direct: bool = False
