"""The setpoints of an autonomy for its vehicle, in the world's local frame."""

from dataclasses import dataclass
from typing import Literal

from wil_campaign.worlds.frames import Vec3


@dataclass(frozen=True, slots=True)
class PositionSetpoint:
    """A setpoint of a position (NED metres, world frame), heading (radians; None keeps it)."""

    position_ned_m: Vec3
    yaw_rad: float | None = None


@dataclass(frozen=True, slots=True)
class VelocitySetpoint:
    """A setpoint of a velocity (NED m/s, world frame), heading (rad) or its rate (rad/s).

    At most one of yaw_rad and yaw_rate_rad_s is given; neither keeps the present heading.
    """

    velocity_ned_m_s: Vec3
    yaw_rad: float | None = None
    yaw_rate_rad_s: float | None = None


Setpoint = PositionSetpoint | VelocitySetpoint

Setpoints = Literal["velocity", "position", "attitude"]
"""The setpoints of an autonomy: velocities or accelerations, positions, or attitudes."""
