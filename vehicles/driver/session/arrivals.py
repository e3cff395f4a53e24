"""Thinned times of arrival of the vehicle's messages, for readers that poll seldom; pure."""

from collections import deque

_NEVER_S = -1.0
STEP_S = 0.2
"""Arrivals nearer to each other than this count as one."""
_MAX_PENDING = 1024


class Arrivals:
    """The times at which a vehicle was received, thinned so that no silence seems longer.

    Two consecutive times from `take` are less than `STEP_S` apart, or nothing arrived between
    them. So a reader that is late itself does not see a silence of the vehicle.
    """

    def __init__(self) -> None:
        self._pending: deque[float] = deque(maxlen=_MAX_PENDING)
        self._last_s = self._noted_s = _NEVER_S

    def note(self, t_s: float) -> None:
        """Record an arrival; times do not decrease."""
        if t_s - self._noted_s >= STEP_S:
            if self._last_s > self._noted_s:
                self._pending.append(self._last_s)
            self._pending.append(t_s)
            self._noted_s = t_s
        self._last_s = t_s

    def take(self) -> tuple[float, ...]:
        """Return the times that were not returned yet, the newest at the end."""
        if self._last_s > self._noted_s:
            self._pending.append(self._last_s)
            self._noted_s = self._last_s
        taken = tuple(self._pending)
        self._pending.clear()
        return taken
