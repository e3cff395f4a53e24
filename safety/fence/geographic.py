"""Fence areas by latitude and longitude, and their conversion to the world's frame."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from wil_campaign.safety.fence.areas import (
    Area,
    Circle,
    FenceError,
    Point2,
    Polygon,
    common_areas,
    require_finite,
)
from wil_campaign.worlds.geodesy import SEMI_MAJOR_M, LocalFrame

FARTHEST_M = 100_000.0
"""How far from the world's origin an area may reach; there the Earth is 800 m below the plane."""


@dataclass(frozen=True, slots=True)
class GeoPolygon:
    """A geographic polygon by its corners (latitude_deg, longitude_deg), not closed.

    Raises FenceError: as `Polygon`, and `latitude` for invalid coordinates.
    """

    corners_deg: tuple[Point2, ...]

    def __post_init__(self) -> None:
        for corner in self.corners_deg:
            require_place(*corner)
        Polygon(_flatten(self.corners_deg))

    def local(self, frame: LocalFrame) -> Polygon:
        """Return the geographic polygon in a world's frame. Raises FenceError when far away."""
        return Polygon(tuple(_to_local(frame, *corner) for corner in self.corners_deg))


@dataclass(frozen=True, slots=True)
class GeoCircle:
    """A geographic circle by centre (latitude_deg, longitude_deg) and radius."""

    centre_deg: Point2
    radius_m: float

    def __post_init__(self) -> None:
        require_place(*self.centre_deg)
        Circle(self.centre_deg, self.radius_m)
        if self.radius_m > FARTHEST_M:
            message = f"a circle of {self.radius_m / 1000:.0f} km: at most 100 km are accepted"
            raise FenceError("far", message)

    def local(self, frame: LocalFrame) -> Circle:
        """Return the geographic circle in a world's frame. Raises FenceError when far away."""
        return Circle(_to_local(frame, *self.centre_deg), self.radius_m)


GeoArea = GeoPolygon | GeoCircle


@dataclass(frozen=True, slots=True)
class DrawnFence:
    """The geographic areas of a fence that was drawn on a map.

    all_of: whether a vehicle has to be inside all inclusions, as the autopilots take those of
    their ground stations' files, and not in any of them.
    """

    inclusions: tuple[GeoArea, ...] = ()
    exclusions: tuple[GeoArea, ...] = ()
    all_of: bool = False

    @property
    def is_common(self) -> bool:
        """Return whether what several inclusions have in common is the fence."""
        return self.all_of and len(self.inclusions) > 1

    def local(self, frame: LocalFrame) -> tuple[tuple[Area, ...], tuple[Area, ...]]:
        """Return a map's inclusions and exclusions in a world's frame. Raises FenceError."""
        inclusions = _all_to_local(frame, self.inclusions)
        if self.is_common:
            inclusions = common_areas(inclusions)
        return inclusions, _all_to_local(frame, self.exclusions)


def require_place(latitude_deg: float, longitude_deg: float) -> None:
    """Raise FenceError for an invalid latitude or longitude."""
    require_finite("latitude and longitude", latitude_deg, longitude_deg)
    if abs(latitude_deg) > 90.0:
        swapped = ""
        if abs(longitude_deg) <= 90.0:
            swapped = "; are latitude and longitude swapped?"
        raise FenceError("latitude", f"latitude {latitude_deg:g} is beyond 90 degrees{swapped}")
    if abs(longitude_deg) > 180.0:
        raise FenceError("latitude", f"longitude {longitude_deg:g} is beyond 180 degrees")


def _flatten(corners_deg: Iterable[Point2]) -> tuple[Point2, ...]:
    """Return geographic corners in metres relative to the first one, to check their area."""
    places = tuple(corners_deg)
    if not places:
        return ()
    latitude_deg, longitude_deg = places[0]
    per_degree_m = math.radians(1.0) * SEMI_MAJOR_M
    narrowed_m = per_degree_m * max(0.01, math.cos(math.radians(latitude_deg)))
    return tuple(
        (
            (lat - latitude_deg) * per_degree_m,
            math.remainder(lon - longitude_deg, 360.0) * narrowed_m,
        )
        for lat, lon in places
    )


def _all_to_local(frame: LocalFrame, areas: Iterable[GeoArea]) -> tuple[Area, ...]:
    """Return geographic areas in a world's frame."""
    return tuple(area.local(frame) for area in areas)


def _to_local(frame: LocalFrame, latitude_deg: float, longitude_deg: float) -> Point2:
    """Return north, east of a latitude and longitude. Raises FenceError when far away."""
    north_m, east_m, _ = frame.to_ned(latitude_deg, longitude_deg, frame.altitude_m)
    away_m = math.hypot(north_m, east_m)
    if away_m <= FARTHEST_M:
        return north_m, east_m
    message = (
        f"({latitude_deg:g}, {longitude_deg:g}) is {away_m / 1000:.0f} km from the world's origin"
    )
    if abs(longitude_deg) <= 90.0:
        north_m, east_m, _ = frame.to_ned(longitude_deg, latitude_deg, frame.altitude_m)
        if math.hypot(north_m, east_m) <= FARTHEST_M:
            message += "; are latitude and longitude swapped?"
    raise FenceError("far", message)
