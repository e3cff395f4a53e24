"""Limits how many events of a kind are handled in each second; pure."""


class RateLimit:
    """Counts events. most: how many of one second are allowed."""

    def __init__(self, *, most: int) -> None:
        self._most = most
        self._second = 0
        self._count = 0

    def is_exceeded(self, now_s: float) -> bool:
        """Count an event, and return whether it exceeds the limit of its second."""
        if int(now_s) != self._second:
            self._second, self._count = int(now_s), 0
        self._count += 1
        return self._count > self._most
