"""Fly straight to a place at walking speed, and stand there: the flight back between runs."""

import math
from collections.abc import Mapping

from wil_campaign.api import Command, PositionSetpoint, Reading, Telemetry, Vec3, norm, subtract

_KNOWN = {"speed_m_s": 1.0, "tolerance_m": 0.15, "still_m_s": 0.15, "for_s": 1.0}
_YAW = "yaw_deg"


class PlaceAutonomy:
    """The shipped autonomy `place`: position setpoints on the line to the goal; done there."""

    def __init__(
        self, *, goal: Mapping[str, float | str], parameters: Mapping[str, object], seed: int
    ) -> None:
        """Raise ValueError on a goal without a place, and on non-numeric parameters.

        parameters: speed_m_s; tolerance_m and still_m_s: distance and speed that count as standing
        at the place, for for_s seconds; yaw_deg: heading at the place, by default as at the start.
        """
        del seed
        if "north_m" not in goal:
            raise ValueError(
                "this autonomy flies to a position: the goal needs position_ned_m or its keys"
            )
        for name, value in parameters.items():
            if name not in {*_KNOWN, _YAW}:
                known = ", ".join((*_KNOWN, _YAW))
                raise ValueError(f"unknown parameter '{name}' (known: {known})")
            is_number = not isinstance(value, bool) and isinstance(value, int | float)
            if not is_number or (name in _KNOWN and not float(str(value)) > 0):
                wanted = "a number" if name == _YAW else "a positive number"
                raise ValueError(f"{name} must be {wanted}, is {value!r}")
        given = {name: float(str(value)) for name, value in parameters.items()}
        self._parameters = _KNOWN | given
        self._yaw_rad = math.radians(given[_YAW]) if _YAW in given else None
        north_m, east_m, up_m = (float(goal[key]) for key in ("north_m", "east_m", "up_m"))
        self._place: Vec3 = (north_m, east_m, -up_m)
        self._start: tuple[float, Vec3] | None = None
        self._standing_since_s: float | None = None

    def perceive(self, reading: Reading) -> None:
        """Ignore the reading: flying to a place needs no perception."""

    def act(self, telemetry: Telemetry) -> Command:
        """Return the position setpoint that moves on the line to the goal's place."""
        own, t_s, position = self._parameters, telemetry.t_s, telemetry.pose.position_ned_m
        if self._start is None:
            self._start = (t_s, position)
            if self._yaw_rad is None:
                self._yaw_rad = telemetry.pose.yaw_rad
        began_s, first = self._start
        way = subtract(self._place, first)
        way_m = norm(way)
        share = min(1.0, own["speed_m_s"] * (t_s - began_s) / way_m) if way_m else 1.0
        north_m, east_m, down_m = (a + share * b for a, b in zip(first, way, strict=True))
        is_near = norm(subtract(self._place, position)) <= own["tolerance_m"]
        is_still = norm(telemetry.velocity_ned_m_s) <= own["still_m_s"]
        if not (share == 1.0 and is_near and is_still):
            self._standing_since_s = None
        elif self._standing_since_s is None:
            self._standing_since_s = t_s
        since_s = self._standing_since_s
        done = since_s is not None and t_s - since_s >= own["for_s"]
        setpoint = PositionSetpoint((north_m, east_m, down_m), self._yaw_rad)
        return Command(setpoint, done=done, note="there" if done else "on the way")
