"""Builds the track of a flight from local positions, places on Earth and headings of a log."""

from bisect import bisect_right
from math import hypot, isfinite

from wil_campaign.plugins.logs.logged_flight import TrackPoint
from wil_campaign.worlds.geodesy import Geodetic, LocalFrame

_AT_MOST_APART_S = 2.0
"""How far apart in time a local position and a place may be to tell the origin by."""
_YAW_WITHIN_S = 0.5
_MOST_M = 1e6


class TrackBuilder:
    """Gathers positions of a log in its own order; `track` and `origin` are the result."""

    def __init__(self) -> None:
        self._local: list[tuple[float, float, float, float]] = []
        self._places: list[tuple[float, Geodetic]] = []
        self._yaws: list[tuple[float, float]] = []
        self._origin: Geodetic | None = None
        self._left_out = 0
        self._no_places = 0

    def local(
        self, t_s: float, north_m: float, east_m: float, down_m: float, *, is_valid: bool = True
    ) -> None:
        """Add a position in the autopilot's local NED frame, in metres. is_valid: by the log."""
        values = (t_s, north_m, east_m, down_m)
        if is_valid and all(map(isfinite, values)) and max(map(abs, values[1:])) < _MOST_M:
            self._local.append((t_s, north_m, east_m, -down_m))
        else:
            self._left_out += 1

    def place(self, t_s: float, latitude_deg: float, longitude_deg: float, alt_m: float) -> None:
        """Add a place on Earth; zeros are no place."""
        if is_place_on_earth(latitude_deg, longitude_deg) and isfinite(alt_m):
            self._places.append((t_s, Geodetic(latitude_deg, longitude_deg, alt_m)))
        else:
            self._no_places += 1

    def yaw(self, t_s: float, yaw_rad: float) -> None:
        """Add a heading."""
        if isfinite(yaw_rad):
            self._yaws.append((t_s, yaw_rad))

    def set_origin(self, latitude_deg: float, longitude_deg: float, alt_m: float) -> None:
        """Set the place of the local frame's origin, unless it is known."""
        if (
            self._origin is None
            and is_place_on_earth(latitude_deg, longitude_deg)
            and isfinite(alt_m)
        ):
            self._origin = Geodetic(latitude_deg, longitude_deg, alt_m)

    @property
    def problems(self) -> tuple[str, ...]:
        """Return in words how many positions of the track were left out; empty for none."""
        out, taken = self._left_out, len(self._local)
        if not taken and self._places:
            out, taken = self._no_places, len(self._places)
        of = out + taken
        return (f"{out} of its {of} positions are invalid, and were left out",) if out else ()

    @property
    def origin(self) -> Geodetic | None:
        """Return the place of the track's origin; None where the log does not tell it."""
        if self._origin is not None:
            return self._origin
        if not self._places:
            return None
        if not self._local:
            return self._places[0][1]
        t_s, place = self._places[0]
        near = min(self._local, key=lambda one: abs(one[0] - t_s))
        if abs(near[0] - t_s) > _AT_MOST_APART_S:
            return None
        frame = _frame(place)
        return frame.to_geodetic((-near[1], -near[2], near[3]))

    @property
    def track(self) -> list[TrackPoint]:
        """Return the track, oldest first: of local positions, or else of places."""
        points = self._local or self._from_places()
        headings = sorted(self._yaws)
        times_s = [t_s for t_s, _ in headings]
        found = []
        for t_s, north_m, east_m, up_m in sorted(points):
            index = bisect_right(times_s, t_s) - 1
            known = index >= 0 and t_s - times_s[index] <= _YAW_WITHIN_S
            yaw_rad = headings[index][1] if known else None
            found.append(TrackPoint(t_s, north_m, east_m, up_m, yaw_rad))
        return found

    def _from_places(self) -> list[tuple[float, float, float, float]]:
        if not self._places:
            return []
        frame = _frame(self._places[0][1])
        found = []
        for t_s, geodetic in self._places:
            north, east, down = frame.to_ned(
                geodetic.latitude_deg, geodetic.longitude_deg, geodetic.altitude_m
            )
            if hypot(north, east) < _MOST_M:
                found.append((t_s, north, east, -down))
        return found


def is_place_on_earth(latitude_deg: float, longitude_deg: float) -> bool:
    """Return whether two angles are a place on Earth, and not the zeros of a missing fix."""
    inside = abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0
    return inside and (abs(latitude_deg) > 1e-6 or abs(longitude_deg) > 1e-6)


def _frame(place: Geodetic) -> LocalFrame:
    return LocalFrame(place.latitude_deg, place.longitude_deg, place.altitude_m)
