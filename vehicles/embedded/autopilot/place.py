"""Local NED metres to latitude and longitude, and back, near one origin.

The radii of curvature of WGS-84 at the origin (Torge, "Geodesy", 2001, section 4.1): good to a
millimetre within a kilometre, and cheap, for a position is sent many times a second.
"""

import math
from dataclasses import dataclass

from worlds.frames import Vec3

_SEMI_MAJOR_M = 6378137.0
_ECCENTRICITY_SQUARED = 6.69437999014e-3


@dataclass(frozen=True, slots=True)
class Geodetic:
    """A place: degrees, and metres above mean sea level."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float


class Place:
    """The origin of a local frame."""

    def __init__(self, origin: Geodetic) -> None:
        self.origin = origin
        latitude = math.radians(origin.latitude_deg)
        w = 1.0 - _ECCENTRICITY_SQUARED * math.sin(latitude) ** 2
        meridian_m = _SEMI_MAJOR_M * (1.0 - _ECCENTRICITY_SQUARED) / w**1.5
        normal_m = _SEMI_MAJOR_M / math.sqrt(w)
        height_m = origin.altitude_m
        self._north_per_degree_m = math.radians(meridian_m + height_m)
        self._east_per_degree_m = math.radians((normal_m + height_m) * math.cos(latitude))

    def geodetic(self, position_ned_m: Vec3) -> Geodetic:
        """Return where a local position is."""
        north, east, down = position_ned_m
        origin = self.origin
        return Geodetic(
            origin.latitude_deg + north / self._north_per_degree_m,
            origin.longitude_deg + east / self._east_per_degree_m,
            origin.altitude_m - down,
        )

    def local(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> Vec3:
        """Return the local position (NED metres) of a place."""
        origin = self.origin
        return (
            (latitude_deg - origin.latitude_deg) * self._north_per_degree_m,
            (longitude_deg - origin.longitude_deg) * self._east_per_degree_m,
            origin.altitude_m - altitude_m,
        )
