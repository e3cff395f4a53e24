"""Pause, speed and time of a finished run that is played; changed by the pages of its console."""

import asyncio
import math
from collections.abc import Callable, Mapping
from typing import Any

from wil_campaign.plugins.console.console_access import AccessError
from wil_campaign.worlds.frames import Vec3

SLOWEST, FASTEST = 0.01, 100.0
_KEYS = frozenset({"paused", "speed", "t_s"})


class Playback:
    """The clock of a finished run: begins at its first time, and ends at its last.

    speed: 1 is real time. time: seconds of a steady clock. show: receives, after each change,
    "playback" with paused, speed, and t_s, first_s and last_s on the run clock.
    """

    def __init__(
        self,
        speed: float = 1.0,
        *,
        time: Callable[[], float],
        show: Callable[[str, Mapping[str, Any]], None] = lambda _kind, _document: None,
    ) -> None:
        self._time = time
        self._show = show
        self._speed = speed
        self._is_paused = False
        self._first_s = self._last_s = 0.0
        self._set_s, self._set_at = 0.0, time()
        self._jumps = self._seen = 0
        self._changed = asyncio.Event()

    @property
    def t_s(self) -> float:
        """Return the time of the run that is shown, on the run clock."""
        passed_s = 0.0 if self._is_paused else (self._time() - self._set_at) * self._speed
        return min(self._set_s + passed_s, self._last_s)

    def begin(self, first_s: float, last_s: float) -> None:
        """Begin a run with these first and last times on the run clock."""
        self._first_s, self._last_s = first_s, last_s
        self.restart()

    def restart(self) -> None:
        """Show the run from its first time, unless a page chose another while it waited."""
        if self._jumps == self._seen:
            self._set(self._first_s)
        self._seen = self._jumps

    async def reach(self, t_s: float) -> bool:
        """Wait until a time of the run; return False as soon as a page jumps in time."""
        while True:
            if self._jumps != self._seen:
                self._seen = self._jumps
                return False
            left_s = t_s - self.t_s
            if left_s <= 0.0:
                return True
            await self._wait(math.inf if self._is_paused else left_s / self._speed)

    async def wait_at_end(self, seconds: float) -> None:
        """Wait at the end of the run; a pause prolongs it, and a jump in time ends it."""
        while self._jumps == self._seen:
            if not await self._wait(math.inf if self._is_paused else seconds):
                return

    async def _wait(self, seconds: float) -> bool:
        """Wait; return whether a change by a page ended it."""
        self._changed.clear()
        try:
            async with asyncio.timeout(None if math.isinf(seconds) else seconds):
                await self._changed.wait()
        except TimeoutError:
            return False
        return True

    def change(self, wanted: Any) -> None:
        """Obey a page: paused, speed or t_s. Raises AccessError."""
        if not isinstance(wanted, dict) or not wanted or set(wanted) - _KEYS:
            raise AccessError("a playback command has the keys paused, speed or t_s")
        paused, speed = wanted.get("paused", self._is_paused), wanted.get("speed", self._speed)
        if not isinstance(paused, bool):
            raise AccessError("paused must be true or false")
        if not _is_number(speed) or not SLOWEST <= speed <= FASTEST:
            raise AccessError(f"speed must be between {SLOWEST} and {FASTEST}")
        t_s = wanted.get("t_s", self.t_s)
        if not _is_number(t_s) or not math.isfinite(t_s):
            raise AccessError("t_s must be a time of the run, in seconds")
        if "t_s" in wanted:
            self._jumps += 1
        # What has passed until now passed at the old speed.
        self._set_s, self._set_at = min(max(t_s, self._first_s), self._last_s), self._time()
        self._is_paused, self._speed = paused, float(speed)
        self._tell()

    def show_past(self, run: str, trails: Mapping[str, list[Vec3]]) -> None:
        """Show where the vehicles of a run were before the time from which it is played."""
        self._show("past", {"run": run, "trails": trails})

    def state(self) -> dict[str, Any]:
        """Return the state that pages show."""
        return {
            "paused": self._is_paused,
            "speed": self._speed,
            "t_s": self.t_s,
            "first_s": self._first_s,
            "last_s": self._last_s,
        }

    def _set(self, t_s: float) -> None:
        self._set_s, self._set_at = t_s, self._time()
        self._tell()

    def _tell(self) -> None:
        self._changed.set()
        self._show("playback", self.state())


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
