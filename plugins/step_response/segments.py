"""The segments of a flight of step responses, and the samples that are taken of them; pure."""

import math
from typing import NamedTuple

from wil_campaign.vehicles.setpoints import PositionSetpoint, Setpoint, VelocitySetpoint

SPEEDS_M_S = (0.4, 0.8, 1.5)
HEIGHT_M = 2.5
TURN_DEG = 60.0
POSITION_STEP_M = 2.0
CLIMB_M_S = 0.5


class StepSample(NamedTuple):
    """The vehicle's estimate, at seconds since its boot: m and m/s (NED), radians."""

    t_s: float
    north_m: float
    east_m: float
    down_m: float
    vn_m_s: float
    ve_m_s: float
    vd_m_s: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float


Series = dict[str, list[StepSample]]
"""The samples of each segment, by its name, in the order in which they are flown."""


class StepSegment(NamedTuple):
    """A segment of the flight: a setpoint that is sent for so long."""

    name: str
    seconds: float
    setpoint: Setpoint


def step_segments(
    speeds_m_s: tuple[float, ...] = SPEEDS_M_S, turn_deg: float = TURN_DEG
) -> tuple[StepSegment, ...]:
    """Return the flight's segments after the takeoff to `HEIGHT_M`.

    In the frame of the vehicle's start: it stands at the origin and looks north.
    """
    hover = (0.0, 0.0, -HEIGHT_M)
    hold = PositionSetpoint(hover, 0.0)
    still = VelocitySetpoint((0.0, 0.0, 0.0), yaw_rad=0.0)
    there = PositionSetpoint((POSITION_STEP_M, 0.0, -HEIGHT_M), 0.0)
    segments: list[StepSegment] = []
    for speed in speeds_m_s:
        forward = VelocitySetpoint((speed, 0.0, 0.0), yaw_rad=0.0)
        segments += [
            StepSegment(f"speed {speed}", 6.0, forward),
            StepSegment(f"stop {speed}", 4.0, still),
            StepSegment(f"back {speed}", 8.0, hold),
        ]
    return (
        *segments,
        StepSegment("position 2", 8.0, there),
        StepSegment("position back", 8.0, hold),
        StepSegment("climb 0.5", 4.0, VelocitySetpoint((0.0, 0.0, -CLIMB_M_S), yaw_rad=0.0)),
        StepSegment("hover", 6.0, hold),
        StepSegment("yaw 60", 8.0, PositionSetpoint(hover, math.radians(turn_deg))),
        StepSegment("yaw back", 6.0, hold),
    )
