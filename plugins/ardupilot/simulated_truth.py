"""The ground truth of ArduPilot's simulator: its message SIM_STATE, and its map projection; pure.

SIM::sim_state_send of libraries/SITL/SITL.cpp: attitude and velocity as floats; lat and lon are
32-bit floats, 0.4 m apart at 47 degrees (versions without lat_int put degrees times 1e7 there):
only lat_int and lon_int are used. Heights are of whole centimetres. It has no time. SIMSTATE has
neither height nor velocity nor time: it is not used.
"""

import math
from dataclasses import dataclass
from typing import Any

from wil_campaign.vehicles.autopilots.ground_truth import (
    GroundTruth,
    GroundTruthError,
    unit_attitude,
)
from wil_campaign.worlds.frames import wrap_pi

ARDUPILOT_M_PER_1E7_DEG = 0.011131884502145034
"""LOCATION_SCALING_FACTOR (ArduPilot, libraries/AP_Common/Location.h)."""


def read_sim_state(message: Any) -> GroundTruth:
    """Return the ground truth in a SIM_STATE. Raises GroundTruthError."""
    if not (message.lat_int or message.lon_int):
        raise GroundTruthError(
            "SIM_STATE has no lat_int and lon_int, and its floats have a resolution of 0.4 m: "
            "use a newer ArduPilot"
        )
    numbers = (message.alt, message.vn, message.ve, message.vd)
    if not all(map(math.isfinite, numbers)):
        raise GroundTruthError("SIM_STATE has a height or velocity that is not a number")
    return GroundTruth(
        latitude_deg=message.lat_int * 1e-7,
        longitude_deg=message.lon_int * 1e-7,
        altitude_m=message.alt,
        q_wxyz=unit_attitude("SIM_STATE", (message.q1, message.q2, message.q3, message.q4)),
        velocity_ned_m_s=(message.vn, message.ve, message.vd),
    )


@dataclass(frozen=True, slots=True)
class ArduPilotProjection:
    """ArduPilot's flat earth: Location::get_distance_NE and Location::offset (Location.cpp).

    A degree north is equally long everywhere; a degree east is shorter by the cosine of the mean
    latitude of both places.
    """

    latitude_deg: float
    longitude_deg: float

    def to_metres(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """Return metres north and east of the origin."""
        turn_deg = math.degrees(wrap_pi(math.radians(longitude_deg - self.longitude_deg)))
        shorter = self._shorter((latitude_deg + self.latitude_deg) / 2.0)
        north_m = (latitude_deg - self.latitude_deg) * 1e7 * ARDUPILOT_M_PER_1E7_DEG
        return north_m, turn_deg * 1e7 * ARDUPILOT_M_PER_1E7_DEG * shorter

    def to_degrees(self, north_m: float, east_m: float) -> tuple[float, float]:
        """Return latitude and longitude of a place, degrees."""
        moved_deg = north_m / ARDUPILOT_M_PER_1E7_DEG * 1e-7
        shorter = self._shorter(self.latitude_deg + moved_deg / 2.0)
        turn_deg = east_m / ARDUPILOT_M_PER_1E7_DEG / shorter * 1e-7
        return self.latitude_deg + moved_deg, self.longitude_deg + turn_deg

    @staticmethod
    def _shorter(latitude_deg: float) -> float:
        """Return Location::longitude_scale: at least 0.01, to not divide by 0 at a pole."""
        return max(math.cos(math.radians(latitude_deg)), 0.01)
