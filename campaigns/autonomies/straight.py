"""Fly straight ahead for a time, without perception: a test of fences, guards and failsafes."""

from collections.abc import Mapping

from wil_campaign.api import Command, Reading, Telemetry, VelocitySetpoint, rotate

_KNOWN = {"speed_m_s": 1.0, "for_s": 10.0}


class StraightAutonomy:
    """The shipped autonomy `straight`: a constant speed along the heading for a time."""

    def __init__(
        self, *, goal: Mapping[str, float | str], parameters: Mapping[str, object], seed: int
    ) -> None:
        """Raise ValueError on unknown or non-positive parameters of `straight`.

        parameters: speed_m_s, for_s. goal, seed: unused.
        """
        del goal, seed
        for name, value in parameters.items():
            if name not in _KNOWN:
                raise ValueError(f"unknown parameter '{name}' (known: {', '.join(_KNOWN)})")
            if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0:
                raise ValueError(f"{name} must be a positive number, is {value!r}")
        chosen = _KNOWN | {name: float(str(value)) for name, value in parameters.items()}
        self._speed_m_s, self._for_s = chosen["speed_m_s"], chosen["for_s"]
        self._began_s: float | None = None
        self._yaw_rad = 0.0
        self._velocity = (0.0, 0.0, 0.0)

    def perceive(self, reading: Reading) -> None:
        """Ignore the reading: straight flight needs no perception."""

    def act(self, telemetry: Telemetry) -> Command:
        """Return the velocity setpoint straight ahead; zero after the time."""
        if self._began_s is None:
            self._began_s = telemetry.t_s
            self._yaw_rad = telemetry.pose.yaw_rad
            north, east, _ = rotate(telemetry.pose.q_wxyz, (self._speed_m_s, 0.0, 0.0))
            self._velocity = (north, east, 0.0)
        if telemetry.t_s - self._began_s < self._for_s:
            return Command(VelocitySetpoint(self._velocity, self._yaw_rad), note="ahead")
        return Command(VelocitySetpoint((0.0, 0.0, 0.0), self._yaw_rad), done=True, note="stop")
