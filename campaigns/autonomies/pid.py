"""A PID controller from an error in metres to a speed command."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PidGains:
    """PID gains: kp in 1/s, ki in 1/s^2, kd without unit; limit_m_s bounds output and integral."""

    kp: float
    ki: float
    kd: float
    limit_m_s: float


class PidController:
    """A PID controller of one axis; the derivative is of the measurement, so steps give no kick."""

    def __init__(self, gains: PidGains) -> None:
        self._gains = gains
        self._integral_m_s = 0.0

    def step(self, error_m: float, speed_m_s: float, dt_s: float) -> float:
        """Return the PID's speed command; speed_m_s: the rate at which the error shrinks now.

        The integral is frozen while the command is at its limit (conditional integration).
        """
        gains = self._gains
        wanted_m_s = gains.kp * error_m - gains.kd * speed_m_s + self._integral_m_s
        command_m_s = max(-gains.limit_m_s, min(gains.limit_m_s, wanted_m_s))
        if command_m_s == wanted_m_s:
            self._integral_m_s += gains.ki * error_m * dt_s
        return command_m_s
