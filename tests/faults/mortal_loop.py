"""Virtual time in which tasks die or are stopped: they stand still, no clean-up of theirs runs."""

import asyncio
from collections.abc import Callable
from contextvars import Context
from typing import Any, TypeVarTuple

from wil_campaign.foundation.clocks.virtual_loop import VirtualLoop

_Ts = TypeVarTuple("_Ts")
_SPARED = (
    "asyncio",
    "wil_campaign.safety.guard",
    "tests.faults",
    "wil_campaign.vehicles.embedded",
    "wil_campaign.vehicles.links",
    "wil_campaign.plugins.impaired_links.impaired",
    "wil_campaign.plugins.redundant_links",
    "wil_campaign.plugins.stream_links",
)
"""Of a killed orchestrator: what belongs to the guard, the vehicles, their links, and to us."""

_Call = tuple[float, Callable[..., object], tuple[Any, ...]]


class MortalLoop(VirtualLoop):
    """A dead task makes no step any more; only its cancellation reaches it, as in a hung one.

    `woken_s` says when a dead task was cancelled first: by a time-out of its own it goes on from
    there, only late. What is dead comes alive again by `thaw`, as a stopped process does.
    """

    def __init__(self) -> None:
        super().__init__()
        self._dead: set[asyncio.Task[Any]] = set()
        self._spared: set[asyncio.Task[Any]] | None = None
        self._kept: list[tuple[asyncio.Task[Any], Callable[..., object], tuple[Any, ...]]] = []
        self._stopped: list[_Call] = []
        self.woken_s: dict[asyncio.Task[Any], float] = {}

    def kill(self, tasks: set[asyncio.Task[Any]]) -> None:
        """Let tasks stand still from now on."""
        self._dead |= tasks
        self._sweep()

    def kill_all_but(self, spared: set[asyncio.Task[Any]]) -> None:
        """Let a process die: tasks and callbacks that are not the guard's or the vehicles'."""
        self._spared = spared
        self._sweep()

    def thaw(self) -> None:
        """Let all that stood still go on from where it was."""
        self._dead.clear()
        self._spared = None
        kept, self._kept = self._kept, []
        stopped, self._stopped = self._stopped, []
        for _, callback, args in kept:
            super().call_soon(callback, *args)
        for when, callback, args in stopped:
            super().call_at(max(when, self.time()), callback, *args)

    def call_soon(
        self, callback: Callable[[*_Ts], object], *args: *_Ts, context: Context | None = None
    ) -> asyncio.Handle:
        """Have it called in the next turn, unless it is dead."""
        handle = super().call_soon(callback, *args, context=context)
        if (self._dead or self._spared is not None) and self._is_dead(callback):
            self._bury(handle, self.time())
        return handle

    def call_at(
        self,
        when: float,
        callback: Callable[[*_Ts], object],
        *args: *_Ts,
        context: Context | None = None,
    ) -> asyncio.TimerHandle:
        """Have it called at a time, unless it is dead."""
        handle = super().call_at(when, callback, *args, context=context)
        if self._spared is not None and self._is_dead(callback):
            self._bury(handle, when)
        return handle

    def _run_once(self) -> None:
        if self._kept:
            self._deliver_cancellations()
        super()._run_once()

    def _sweep(self) -> None:
        waiting = [(self.time(), handle) for handle in self._callbacks]
        waiting += [(when, timer) for when, _, timer in sorted(self._timers, key=_by_time)]
        for when, handle in waiting:
            if not handle.cancelled() and self._is_dead(handle._callback):  # type: ignore[attr-defined]
                self._bury(handle, when)

    def _bury(self, handle: asyncio.Handle, when_s: float) -> None:
        callback: Any = handle._callback  # type: ignore[attr-defined]
        args: tuple[Any, ...] = tuple(handle._args)
        owner = getattr(callback, "__self__", None)
        if isinstance(owner, asyncio.Task):
            self._kept.append((owner, callback, args))
        else:
            self._stopped.append((when_s, callback, args))
        handle.cancel()

    def _deliver_cancellations(self) -> None:
        if self._spared is not None:
            return
        for one in [one for one in self._kept if one[0].cancelling()]:
            self._kept.remove(one)
            self._wake(one[0])
            super().call_soon(one[1], *one[2])

    def _wake(self, task: asyncio.Task[Any]) -> None:
        self._dead.discard(task)
        self.woken_s.setdefault(task, self.time())

    def _is_dead(self, callback: Any) -> bool:
        owner = getattr(callback, "__self__", None)
        if isinstance(owner, asyncio.Task):
            if self._spared is not None:
                return owner not in self._spared
            if owner in self._dead and owner.cancelling():
                self._wake(owner)
            return owner in self._dead
        if self._spared is None:
            return False
        module = type(owner).__module__ if owner is not None else _module_of(callback)
        return not module.startswith(_SPARED) and module != "_asyncio"


def _by_time(timer: tuple[float, int, asyncio.TimerHandle]) -> tuple[float, int]:
    return timer[:2]


def _module_of(callback: Any) -> str:
    inner = getattr(callback, "func", callback)
    return str(getattr(inner, "__module__", "") or "")
