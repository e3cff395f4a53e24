"""The speed profile of a leg: constant, or with constant acceleration at both ends; pure.

A leg's time runs from 0 to 1 and so does its way. `ramp` is the share of the time in which speed
rises, and again that in which it falls: 0 for a constant speed, 0.5 for a leg that is too short
to reach its speed.
"""

import math


def ramped_leg(length_m: float, speed_m_s: float, acceleration_m_s2: float) -> tuple[float, float]:
    """Return the time (s) and the ramp of a leg from rest to rest, at most at a speed."""
    if length_m <= 0.0:
        return 0.0, 0.0
    if speed_m_s * speed_m_s >= acceleration_m_s2 * length_m:
        return 2.0 * math.sqrt(length_m / acceleration_m_s2), 0.5
    rise_s = speed_m_s / acceleration_m_s2
    duration_s = length_m / speed_m_s + rise_s
    return duration_s, rise_s / duration_s


def way_share(time_share: float, ramp: float) -> float:
    """Return the share of a ramped leg's length that is completed at a share of its time."""
    if ramp <= 0.0:
        return time_share
    left = 1.0 - time_share
    if min(time_share, left) < ramp:
        end = min(time_share, left)
        part = end * end / (2.0 * ramp * (1.0 - ramp))
        return part if time_share < left else 1.0 - part
    return (time_share - ramp / 2.0) / (1.0 - ramp)
