"""What pace a simulation is told, so that it keeps the time of one whose pace cannot be set; pure.

PX4 simulating by itself (SIH) sleeps between its steps and does not make good what a sleep lasts
too long: asked for twice real time it attains 1.96. ArduPilot's simulator attains what it is asked
for. So their times come apart by a second within half a minute of the wall's, on an idle machine
too. ArduPilot's pace is a parameter (SIM_SPEEDUP) that it takes while it flies.
"""

import math

_MAKES_GOOD_S = 4.0
"""Within which a difference is made good, in the wall's seconds."""
_ASK_EVERY_S = 0.5
_WORTH_ASKING = 0.002
"""Of the nominal pace: a smaller change is not asked for."""
_SLOWEST, _FASTEST = 0.5, 1.25
"""Of the nominal pace: beyond, the other simulation hangs, or was asked for too much."""


class PaceTrim:
    """Trims the pace of a simulation that can be told one. nominal: what it was started with."""

    def __init__(self, *, nominal: float) -> None:
        self._nominal = nominal
        self._asked = nominal
        self._asked_s = -math.inf

    def update(self, *, wall_s: float, ahead_s: float, rate: float) -> float | None:
        """Return the pace that is to be asked for now; None to leave it.

        ahead_s: by how much the simulation's time is ahead of that of the other. rate: of the
        other's, times real time.
        """
        if wall_s - self._asked_s < _ASK_EVERY_S:
            return None
        wanted = rate - ahead_s / _MAKES_GOOD_S
        wanted = min(max(wanted, _SLOWEST * self._nominal), _FASTEST * self._nominal)
        if abs(wanted - self._asked) < _WORTH_ASKING * self._nominal:
            return None
        self._asked, self._asked_s = wanted, wall_s
        return wanted
