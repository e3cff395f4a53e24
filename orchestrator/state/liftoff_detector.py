"""Detects the liftoff of a vehicle by its own estimate, which drifts on the ground; pure.

A real autopilot's height drifts before liftoff: in PX4's own simulation by up to 0.4 m between
arming and takeoff, at up to 0.3 m/s for a moment. So neither a height nor a speed alone shows a
liftoff; a climb that lasts for a second does.
"""

from collections import deque

_CLIMBS_M_S = 0.2
_RISEN_M = 0.2
_WITHIN_S = 1.0
_ABOVE_M = 0.1


class LiftoffDetector:
    """Detects the liftoff of an armed vehicle from its heights.

    doubt_s: by how much the times were in doubt at most, until the liftoff is known.
    """

    def __init__(self) -> None:
        self.doubt_s = 0.0
        self._recent: deque[tuple[float, float, float]] = deque()
        self._climbed_s: float | None = None
        self._above_s: float | None = None

    @property
    def liftoff_s(self) -> float | None:
        """Return when liftoff began; None before it is known.

        For a climb too slow to detect: when the height last rose above 0.1 m.
        """
        return self._above_s if self._climbed_s is None else self._climbed_s

    def observe(
        self, t_s: float, *, height_m: float, climb_m_s: float, doubt_s: float = 0.0
    ) -> None:
        """Add an armed vehicle's height above its start, and its climb rate.

        doubt_s: by how much the time may be off.
        """
        if self._climbed_s is not None:
            return
        self.doubt_s = max(self.doubt_s, doubt_s)
        if height_m <= _ABOVE_M:
            self._above_s = None
        elif self._above_s is None:
            self._above_s = t_s
        recent = self._recent
        recent.append((t_s, height_m, climb_m_s))
        while t_s - recent[0][0] >= _WITHIN_S:
            began_s, from_m, speed_m_s = recent.popleft()
            if speed_m_s >= _CLIMBS_M_S and height_m - from_m >= _RISEN_M:
                self._climbed_s = began_s
                recent.clear()
                return
