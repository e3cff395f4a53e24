"""The interface of a guard, in this process or in its own, and what both share."""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Self

from wil_campaign.foundation.tasks import SuppressedErrors
from wil_campaign.safety.guard.core.commands import Command
from wil_campaign.safety.guard.core.contingency import ContingencyPhase
from wil_campaign.safety.guard.core.events import GuardEvent
from wil_campaign.safety.model.samples import PoseSample


class Guard(ABC):
    """The guard between orchestrator and vehicles; an async context manager.

    Its decisions are reported as events; `events` holds all of them so far. Leaving the context
    ends it: land before that.
    """

    def __init__(self) -> None:
        self.events: list[GuardEvent] = []
        self._listeners: list[Callable[[GuardEvent], None]] = []
        self._down = asyncio.Event()
        self._rest = asyncio.Event()

    @property
    @abstractmethod
    def phases(self) -> Mapping[str, ContingencyPhase]:
        """Return the contingency phase of each vehicle in the guard."""

    @abstractmethod
    async def __aenter__(self) -> Self:
        """Open the guard's links. Raises LinkError."""

    @abstractmethod
    async def __aexit__(self, *_: object) -> None:
        """Close the guard's links."""

    @abstractmethod
    def position(self, sample: PoseSample) -> None:
        """Give the guard a vehicle's position, from the fastest available source."""

    @abstractmethod
    def send(self, command: Command) -> None:
        """Have the guard execute a command."""

    def on_event(self, listener: Callable[[GuardEvent], None]) -> None:
        """Register a listener for every event of the guard, called from the event loop.

        Now with those so far: an operator may abort while a run's vehicles and autonomies start.
        """
        self._listeners.append(listener)
        for event in tuple(self.events):
            _tell(listener, event)

    async def all_down(self, timeout_s: float) -> bool:
        """Wait until the guard brought all down; False when not within `timeout_s`."""
        return await _is_set(self._down, timeout_s)

    async def at_rest(self, timeout_s: float) -> bool:
        """Wait until the guard sees nothing armed; False when not within `timeout_s`."""
        return await _is_set(self._rest, timeout_s)

    def _show(self, *, at_rest: bool, all_down: bool) -> None:
        """Let those that wait for rest, or for all to be down, continue when it is so."""
        for event, holds in ((self._rest, at_rest), (self._down, all_down)):
            if holds:
                event.set()
            else:
                event.clear()

    def _report(self, event: GuardEvent) -> None:
        self.events.append(event)
        for listener in self._listeners:
            _tell(listener, event)


def _tell(listener: Callable[[GuardEvent], None], event: GuardEvent) -> None:
    with SuppressedErrors(f"a listener to the guard ({event.kind})"):
        listener(event)


async def _is_set(event: asyncio.Event, within_s: float) -> bool:
    try:
        async with asyncio.timeout(within_s):
            await event.wait()
    except TimeoutError:
        return False
    return True
