"""ArduPilot's SITL wind: SIM_WIND_SPD from SIM_WIND_DIR, less near the ground."""

import math
from collections.abc import Callable

from wil_campaign.vehicles.embedded.autopilot.flight.parameter_table import ParameterTable
from wil_campaign.worlds.frames import Vec3

_FULL_M = 60.0
"""SIM_WIND_T_ALT: from this height on the wind has its whole speed."""


def simulated_wind(parameters: ParameterTable, height_m: Callable[[], float]) -> Vec3:
    """Return the wind towards north, east and down, m/s; height_m: over the start.

    As SITL_State.cpp with SIM_WIND_T 0: below 60 m it grows with the square root of the height.
    SIM_WIND_DIR is where the wind comes from.
    """
    speed_m_s = parameters["SIM_WIND_SPD"]
    if not speed_m_s > 0.0:
        return (0.0, 0.0, 0.0)
    speed_m_s *= math.sqrt(min(max(height_m() / _FULL_M, 0.0), 1.0))
    from_rad = math.radians(parameters["SIM_WIND_DIR"])
    return (-speed_m_s * math.cos(from_rad), -speed_m_s * math.sin(from_rad), 0.0)
