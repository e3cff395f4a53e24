"""An event loop with short turns: for a process that wakes often, and does little each time.

On a busy machine the processor's caches hold nothing of such a process when it wakes. Then a turn
of asyncio's own loop costs as much as passing on a frame.
"""

# ruff: noqa: SLF001 - asyncio's own loops read the handles' fields so

import asyncio
import select
import selectors
from collections import deque
from collections.abc import Callable
from heapq import heappop
from time import monotonic
from typing import Any

_EVENTS_A_TURN = 16
_OF_LOOP = frozenset(
    {
        "_clock_resolution",
        "_debug",
        "_ready",
        "_scheduled",
        "_selector",
        "_stopping",
        "_timer_cancelled_count",
    }
)
_OF_SELECTOR = frozenset(("_fd_to_key", "_selector"))
"""The private attributes of asyncio's loop and selector that a quick loop uses."""
_OF_HANDLES = ((asyncio.Handle, "_cancelled"), (asyncio.TimerHandle, "_when"))
_MANY_CANCELLED = 50
"""So many cancelled timers are left to asyncio's own turn, which drops them all."""


class QuickLoop(asyncio.SelectorEventLoop):
    """asyncio's selector loop with a shorter turn, in the same order; on Linux only.

    asyncio makes the turn itself in debug mode, and where many timers were cancelled.
    """

    def __init__(self) -> None:
        selector = selectors.EpollSelector()
        super().__init__(selector)
        inner, self._own = vars(selector), vars(self)
        self._keys: dict[int, selectors.SelectorKey] = inner["_fd_to_key"]
        self._poll: Callable[[float, int], list[tuple[int, int]]] = inner["_selector"].poll
        self._callbacks: deque[asyncio.Handle] = self._own["_ready"]
        self._resolution_s: float = self._own["_clock_resolution"]
        self._no_reader, self._no_writer = select.EPOLLOUT, select.EPOLLIN

    def _run_once(self) -> None:  # noqa: C901 - one function for speed, see below
        """Make one turn of asyncio's `run_forever`."""
        # One function: a turn's cost is rather the number of functions that it touches than their
        # work, since none of them is in the caches.
        own, callbacks = self._own, self._callbacks
        if own["_timer_cancelled_count"] > _MANY_CANCELLED or own["_debug"]:
            super()._run_once()  # type: ignore[misc]  # typeshed leaves it out
            return
        timers: list[Any] = own["_scheduled"]
        while timers and timers[0]._cancelled:
            own["_timer_cancelled_count"] -= 1
            heappop(timers)._scheduled = False
        if callbacks or own["_stopping"]:
            wait_s = 0.0
        else:
            wait_s = max(0.0, timers[0]._when - monotonic()) if timers else -1.0
        for descriptor, events in self._poll(wait_s, _EVENTS_A_TURN):
            # An error or a hang-up is for both, as asyncio has it.
            reader, writer = self._keys[descriptor].data
            if reader is not None and events & ~self._no_reader:
                callbacks.append(reader)
            if writer is not None and events & ~self._no_writer:
                callbacks.append(writer)
        if timers:
            end_s = monotonic() + self._resolution_s
            while timers and timers[0]._when < end_s:
                timer = heappop(timers)
                timer._scheduled = False
                callbacks.append(timer)
        for _ in range(len(callbacks)):
            handle = callbacks.popleft()
            if not handle._cancelled:
                handle._run()


def quick_loop() -> asyncio.AbstractEventLoop:
    """Return a quick loop; asyncio's own without epoll, or if its private parts differ."""
    if not hasattr(selectors, "EpollSelector") or not _is_as_expected():
        return asyncio.new_event_loop()
    return QuickLoop()


def _is_as_expected() -> bool:
    """Return whether asyncio's own loop and selector have the parts that a quick loop uses."""
    loop = asyncio.SelectorEventLoop(selectors.EpollSelector())
    try:
        has_parts = vars(loop).keys() >= _OF_LOOP and hasattr(loop, "_run_once")
        has_parts = has_parts and all(hasattr(kind, name) for kind, name in _OF_HANDLES)
        return has_parts and vars(vars(loop)["_selector"]).keys() >= _OF_SELECTOR
    finally:
        loop.close()
