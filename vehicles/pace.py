"""A loop whose clock runs faster or slower than the wall's: all that it counts is counted so."""

import asyncio
import selectors
import time


class _PacedSelector(selectors.DefaultSelector):
    """Waits for as much of the wall's time as the loop's own time takes."""

    speed = 1.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Return ready descriptors; `timeout` is in the loop's time."""
        return super().select(timeout / self.speed if timeout else timeout)


class PacedLoop(asyncio.SelectorEventLoop):
    """An asyncio loop with `speed` seconds in each of the wall's; it begins at CLOCK_MONOTONIC.

    speed: more than 0.
    """

    def __init__(self, speed: float) -> None:
        self._began_s = time.monotonic()
        self._speed = speed
        waits = _PacedSelector()
        waits.speed = speed
        super().__init__(waits)

    def time(self) -> float:
        """Return the clock's time in seconds."""
        return self._began_s + (time.monotonic() - self._began_s) * self._speed
