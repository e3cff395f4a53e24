"""Adjusts the pace of one simulation so that it keeps time with another of fixed pace; pure.

PX4's own simulation (SIH) sleeps between its steps and does not make up for oversleeping: at a
requested twice real time it attains 1.96. ArduPilot's simulator attains the requested pace. So
their times differ by a second after half a minute of wall time, even on an idle machine. ArduPilot
accepts a new pace in flight, by its parameter SIM_SPEEDUP.
"""

import math

_MAKE_UP_WITHIN_S = 4.0
"""A difference is made up within this wall time."""
_REQUEST_EVERY_S = 0.5
_LEAST_CHANGE = 0.002
"""Of the nominal pace: a smaller change is not requested."""
_SLOWEST, _FASTEST = 0.5, 1.25
"""Of the nominal pace: beyond, the other simulation hangs, or its pace is set too high."""


class PaceTrim:
    """Trims the pace of a simulation in flight. nominal: the pace that it was started with."""

    def __init__(self, *, nominal: float) -> None:
        self._nominal = nominal
        self._requested = nominal
        self._requested_s = -math.inf

    def update(self, *, wall_s: float, ahead_s: float, rate: float) -> float | None:
        """Return the pace to request now; None to leave it.

        ahead_s: by how much the simulation's time is ahead of the other's. rate: the other's pace,
        times real time.
        """
        if wall_s - self._requested_s < _REQUEST_EVERY_S:
            return None
        wanted = rate - ahead_s / _MAKE_UP_WITHIN_S
        wanted = min(max(wanted, _SLOWEST * self._nominal), _FASTEST * self._nominal)
        if abs(wanted - self._requested) < _LEAST_CHANGE * self._nominal:
            return None
        self._requested, self._requested_s = wanted, wall_s
        return wanted
