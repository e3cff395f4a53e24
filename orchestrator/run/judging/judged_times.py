"""Selects the poses of a vehicle that are judged: at most 50 a second, also with jitter; pure."""

import math

_EVERY_S = 0.02
_EARLY_S = 0.008
"""How early a pose may be. In simulation PX4 stamps messages sent at 50 Hz by the steps of its own
loop, 16 and 24 ms apart."""


class JudgedTimes:
    """Chooses the poses of one vehicle that are judged, by their times.

    Times are compared with a grid that a late pose does not shift: of a jittering source at 50 Hz
    each pose is judged, of one at 100 Hz every other.
    """

    def __init__(self) -> None:
        self._due_s = -math.inf

    def is_due(self, t_s: float) -> bool:
        """Return whether the pose of a time is to be judged; if so, the next one is due later."""
        if t_s < self._due_s - _EARLY_S:
            return False
        self._due_s = max(self._due_s, t_s - _EARLY_S) + _EVERY_S
        return True
