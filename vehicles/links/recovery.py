"""Having a lost link again: waits that grow, and a word to people once per loss and return."""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from vehicles.links.base import LinkError

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class BackOff:
    """How long to wait before each try: twice as long as before, up to `longest_s`."""

    first_s: float = 0.2
    longest_s: float = 3.0

    def after(self, failures: int) -> float:
        """Return the wait before the next try."""
        return min(self.first_s * 2.0 ** min(failures, 30), self.longest_s)


class Recovery:
    """Tries to have a link again in a task of its own until it has, or is stopped.

    again: opens the link; raises LinkError when it cannot. A loss is logged once, and once when
    the link is back.
    """

    def __init__(
        self, *, name: str, again: Callable[[], Awaitable[None]] | None, back_off: BackOff
    ) -> None:
        self._name = name
        self._again = again
        self._back_off = back_off
        self._task: asyncio.Task[None] | None = None
        self._lost_s: float | None = None
        self.trouble = ""
        """Why it is lost, or why it could not be had again; empty while it is there."""
        self.losses = 0

    def lost(self, why: str) -> None:
        """Note that the link is gone, and begin to try."""
        if self._lost_s is not None:
            return
        self._lost_s = asyncio.get_running_loop().time()
        self.losses += 1
        self.trouble = why
        _log.warning("%s: lost (%s)", self._name, why)
        if self._again is not None:
            self._task = asyncio.create_task(self._try(self._again), name=f"{self._name}: again")

    def back(self) -> None:
        """Note that the link is there again."""
        if self._lost_s is None:
            return
        gap_s = asyncio.get_running_loop().time() - self._lost_s
        self._lost_s = None
        self.trouble = ""
        _log.warning("%s: back after %.1f s", self._name, gap_s)

    async def stop(self) -> None:
        """Try no more."""
        task, self._task = self._task, None
        self._lost_s = None
        if task is not None:
            task.cancel()
            await asyncio.wait({task})

    async def _try(self, again: Callable[[], Awaitable[None]]) -> None:
        failures = 0
        while True:
            await asyncio.sleep(self._back_off.after(failures))
            try:
                await again()
            except LinkError as error:
                self.trouble = str(error).removeprefix(f"{self._name}: ")
                failures += 1
            else:
                self.back()
                return
