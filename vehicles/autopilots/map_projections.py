"""Map projections of simulators: latitude and longitude to metres and back; PX4's; pure.

A simulator computes in metres and sends degrees. Converted to metres by WGS-84, distances are up
to 0.3 % wrong (3 cm at 10 m); the autopilot's own projection, on a sphere, returns the simulator's
metres.
"""

import math
from dataclasses import dataclass
from typing import Protocol

PX4_EARTH_RADIUS_M = 6_371_000.0
"""CONSTANTS_RADIUS_OF_EARTH (PX4, src/lib/geo/geo.h)."""


class MapProjection(Protocol):
    """A projection around its origin: degrees to metres north and east, and back (protocol)."""

    def to_metres(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """Return metres north and east of the origin."""

    def to_degrees(self, north_m: float, east_m: float) -> tuple[float, float]:
        """Return latitude and longitude, degrees."""


@dataclass(frozen=True, slots=True)
class Px4Projection:
    """PX4's MapProjection: azimuthal equidistant on a sphere (src/lib/geo/geo.cpp)."""

    latitude_deg: float
    longitude_deg: float

    def to_metres(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """Return metres north and east of the origin, along the great circle."""
        latitude, origin = math.radians(latitude_deg), math.radians(self.latitude_deg)
        turn = math.radians(longitude_deg - self.longitude_deg)
        north = math.cos(origin) * math.sin(latitude)
        north -= math.sin(origin) * math.cos(latitude) * math.cos(turn)
        east = math.cos(latitude) * math.sin(turn)
        toward = math.sin(origin) * math.sin(latitude)
        toward += math.cos(origin) * math.cos(latitude) * math.cos(turn)
        sine = math.hypot(north, east)
        # The arc is longer than its sine; atan2 is exact for metres, where acos loses precision.
        longer = math.atan2(sine, toward) / sine if sine > 0.0 else 1.0
        return north * longer * PX4_EARTH_RADIUS_M, east * longer * PX4_EARTH_RADIUS_M

    def to_degrees(self, north_m: float, east_m: float) -> tuple[float, float]:
        """Return latitude and longitude of a place, degrees."""
        origin = math.radians(self.latitude_deg)
        away_m = math.hypot(north_m, east_m)
        arc = away_m / PX4_EARTH_RADIUS_M
        if away_m == 0.0:
            return self.latitude_deg, self.longitude_deg
        north, east = north_m / away_m, east_m / away_m
        sine = math.cos(arc) * math.sin(origin) + north * math.sin(arc) * math.cos(origin)
        turn = math.atan2(
            east * math.sin(arc),
            math.cos(origin) * math.cos(arc) - north * math.sin(origin) * math.sin(arc),
        )
        return math.degrees(math.asin(sine)), self.longitude_deg + math.degrees(turn)
