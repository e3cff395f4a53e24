"""Fly straight to a place at a walking pace, and say so when there: the way back between runs."""

import math
from collections.abc import Mapping

from campaigns.api import Command, PositionSetpoint, Reading, Telemetry, Vec3, norm, subtract

_KNOWN = {"speed_m_s": 1.0, "tolerance_m": 0.15, "still_m_s": 0.15, "for_s": 1.0}
_FACE = "yaw_deg"


class PlaceAutonomy:
    """The shipped autonomy `place`: position setpoints on the line to the goal; done there."""

    def __init__(
        self, *, goal: Mapping[str, float | str], parameters: Mapping[str, object], seed: int
    ) -> None:
        """Raise ValueError on a goal without a place, and on non-numeric parameters.

        parameters: speed_m_s; tolerance_m and still_m_s for how long (for_s) it has to stand there;
        yaw_deg: which way it faces in the end, without it as before.
        """
        del seed
        if "north_m" not in goal:
            raise ValueError(
                "this autonomy flies to a position: the goal needs position_ned_m or its keys"
            )
        for name, value in parameters.items():
            if name not in {*_KNOWN, _FACE}:
                known = ", ".join((*_KNOWN, _FACE))
                raise ValueError(f"unknown parameter '{name}' (there are {known})")
            number = not isinstance(value, bool) and isinstance(value, int | float)
            if not number or (name in _KNOWN and not float(str(value)) > 0):
                wanted = "a number" if name == _FACE else "a positive number"
                raise ValueError(f"{name} must be {wanted}, is {value!r}")
        given = {name: float(str(value)) for name, value in parameters.items()}
        self._chosen = _KNOWN | given
        self._yaw_rad = math.radians(given[_FACE]) if _FACE in given else None
        north_m, east_m, up_m = (float(goal[key]) for key in ("north_m", "east_m", "up_m"))
        self._place: Vec3 = (north_m, east_m, -up_m)
        self._from: tuple[float, Vec3] | None = None
        self._there_s: float | None = None

    def perceive(self, reading: Reading) -> None:
        """Ignore the reading: flying to a place needs no perception."""

    def act(self, telemetry: Telemetry) -> Command:
        """Return the position setpoint on the line to the goal's place at this time."""
        t_s, here = telemetry.t_s, telemetry.pose.position_ned_m
        if self._from is None:
            self._from = (t_s, here)
            if self._yaw_rad is None:
                self._yaw_rad = telemetry.pose.yaw_rad
        began_s, first = self._from
        way = subtract(self._place, first)
        way_m = norm(way)
        share = min(1.0, self._chosen["speed_m_s"] * (t_s - began_s) / way_m) if way_m else 1.0
        north_m, east_m, down_m = (a + share * b for a, b in zip(first, way, strict=True))
        near = norm(subtract(self._place, here)) <= self._chosen["tolerance_m"]
        still = norm(telemetry.velocity_ned_m_s) <= self._chosen["still_m_s"]
        if not (share == 1.0 and near and still):
            self._there_s = None
        elif self._there_s is None:
            self._there_s = t_s
        done = self._there_s is not None and t_s - self._there_s >= self._chosen["for_s"]
        setpoint = PositionSetpoint((north_m, east_m, down_m), self._yaw_rad)
        return Command(setpoint, done=done, note="there" if done else "on the way")
