"""The limits of setpoints that the guard applies, as the campaign gives them."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class SetpointLimits:
    """The limits of setpoints sent to a vehicle; None where there is none.

    speed_m_s: of all axes together. acceleration_m_s2: how fast a velocity setpoint may change.
    floor_up_m, ceiling_up_m: heights over the world's origin. inside_fence: no setpoint may lead
    out of the vehicle's fence. keep_m: the distance that is kept to fence, floor and ceiling.
    """

    speed_m_s: float | None = None
    acceleration_m_s2: float | None = None
    floor_up_m: float | None = None
    ceiling_up_m: float | None = None
    inside_fence: bool = False
    keep_m: float = 0.3
