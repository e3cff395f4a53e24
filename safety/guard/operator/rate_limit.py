"""How much of what comes too often is let through: so many in each second; pure."""


class RateLimit:
    """Counts what comes. most: of one second that are not too many."""

    def __init__(self, *, most: int) -> None:
        self._most = most
        self._second = 0
        self._count = 0

    def is_exceeded(self, now_s: float) -> bool:
        """Count one more, and return whether it is too many in its second."""
        if int(now_s) != self._second:
            self._second, self._count = int(now_s), 0
        self._count += 1
        return self._count > self._most
