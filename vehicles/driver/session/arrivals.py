"""When something of the vehicle arrived, for whoever looks at it seldom, or late; pure."""

from collections import deque

_NEVER_S = -1.0
STEP_S = 0.2
"""Arrivals nearer to each other than this are not told apart."""
_MOST = 1024


class Arrivals:
    """The times at which a vehicle was heard, thinned so that no silence comes out longer.

    Two times that follow each other in what `take` returns are less than `STEP_S` apart, or
    nothing arrived between them. So a reader that itself was late sees no silence of the vehicle.
    """

    def __init__(self) -> None:
        self._pending: deque[float] = deque(maxlen=_MOST)
        self._last_s = self._noted_s = _NEVER_S

    def note(self, t_s: float) -> None:
        """Note that something arrived at a time, which is not before that of the last."""
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
