"""Speeds from which a multicopter stops in time, which reacts to a command after a delay."""

import math


def stopping_speed(distance_m: float, *, acceleration_m_s2: float, reaction_s: float) -> float:
    """Return the speed v that stops within a distance: distance = v reaction + v^2 / 2a; m/s."""
    lost_m_s = acceleration_m_s2 * reaction_s
    squared = lost_m_s * lost_m_s + 2.0 * acceleration_m_s2 * max(0.0, distance_m)
    return math.sqrt(squared) - lost_m_s
