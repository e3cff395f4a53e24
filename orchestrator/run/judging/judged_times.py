"""Which poses of a vehicle are judged: at most 50 a second, however they jitter; pure."""

import math

_EVERY_S = 0.02
_EARLY_S = 0.008
"""How early a pose may be. Firmwares in simulation stamp what they send 50 times a second by steps
of their own loop: 16 and 24 ms apart (PX4). Half of a period at 100 Hz is more."""


class JudgedTimes:
    """Chooses the poses of one vehicle that are judged, by their times.

    Times are held to a grid that a late pose does not shift: of a jittering source of 50 a second
    each is judged, of one of 100 a second every other.
    """

    def __init__(self) -> None:
        self._due_s = -math.inf

    def is_due(self, t_s: float) -> bool:
        """Return whether the pose of a moment is to be judged, and count it if so."""
        if t_s < self._due_s - _EARLY_S:
            return False
        self._due_s = max(self._due_s, t_s - _EARLY_S) + _EVERY_S
        return True
