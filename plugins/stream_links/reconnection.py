"""Reconnects lost links with exponential back-off, and logs each loss and each return once."""

import asyncio
import logging
import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from wil_campaign.foundation.tasks import start_task, stop_tasks
from wil_campaign.vehicles.links.link import LinkError

_log = logging.getLogger(__name__)

_STEADY_S = 5.0
_HELD_S = 0.25
_FLAPS = 3


@dataclass(frozen=True, slots=True)
class BackOff:
    """The back-off of reconnection: each wait twice the last, up to `longest_s`."""

    first_s: float = 0.2
    longest_s: float = 3.0

    def after(self, failures: int) -> float:
        """Return the wait before the next reconnection."""
        return min(self.first_s * 2.0 ** min(failures, 30), self.longest_s)


class Reconnection:
    """Reconnects a lost link in a task of its own until connected or stopped.

    reconnect: opens the link; raises LinkError when it cannot. A loss is logged once, and once when
    the link is back. The third loss of a flapping link is logged as such, and nothing more until
    the link has held for `_STEADY_S`. A link that is lost within `_HELD_S` counts as a failed
    attempt, so that the waits grow; one that held longer is reopened after the first wait, since a
    vehicle may be flying by it.
    """

    def __init__(
        self, *, name: str, reconnect: Callable[[], Awaitable[None]] | None, back_off: BackOff
    ) -> None:
        self._name = name
        self._reconnect = reconnect
        self._back_off = back_off
        self._task: asyncio.Task[None] | None = None
        self._lost_s: float | None = None
        self._back_s: float | None = None
        self._steady: asyncio.TimerHandle | None = None
        self._unsteady = 0
        self._failures = 0
        self.trouble = ""
        """Why the link is lost, or why reconnecting failed; empty while connected."""
        self.losses = 0

    def lost(self, why: str) -> None:
        """Note that the link is lost, and start to reconnect."""
        if self._lost_s is not None:
            return
        self._lost_s = now_s = asyncio.get_running_loop().time()
        held_s = math.inf if self._back_s is None else now_s - self._back_s
        self._failures = self._failures + 1 if held_s < _HELD_S else 0
        self._cancel_steady()
        self._unsteady = self._unsteady + 1 if held_s < _STEADY_S else 1
        self.losses += 1
        self.trouble = why
        if self._unsteady < _FLAPS:
            _log.warning("%s: lost (%s)", self._name, why)
        elif self._unsteady == _FLAPS:
            _log.warning(
                "%s: lost again (%s): the link flaps; further losses are not logged until "
                "it holds for %g s",
                self._name,
                why,
                _STEADY_S,
            )
        if self._reconnect is not None:
            self._task = start_task(self._retry(self._reconnect), name=f"{self._name}: reconnect")

    def back(self) -> None:
        """Note that the link is connected again."""
        if self._lost_s is None:
            return
        loop = asyncio.get_running_loop()
        self._back_s, gap_s = loop.time(), loop.time() - self._lost_s
        self._lost_s = None
        self.trouble = ""
        if self._unsteady < _FLAPS:
            _log.warning("%s: back after %.1f s", self._name, gap_s)
        else:
            self._steady = loop.call_later(_STEADY_S, self._on_steady)

    async def stop(self) -> None:
        """Stop reconnecting."""
        task, self._task = self._task, None
        self._lost_s = None
        self._cancel_steady()
        if task is not None:
            await stop_tasks(task)

    def _on_steady(self) -> None:
        _log.warning("%s: back, and steady; it was lost %d times", self._name, self._unsteady)
        self._unsteady, self._steady = 0, None

    def _cancel_steady(self) -> None:
        if self._steady is not None:
            self._steady.cancel()
            self._steady = None

    async def _retry(self, reconnect: Callable[[], Awaitable[None]]) -> None:
        while True:
            await asyncio.sleep(self._back_off.after(self._failures))
            try:
                await reconnect()
            except LinkError as error:
                self.trouble = str(error).removeprefix(f"{self._name}: ")
                self._failures += 1
            else:
                self.back()
                return
