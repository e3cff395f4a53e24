"""Virtual time in which tasks die: they stand still, and no clean-up of theirs runs."""

import asyncio
from collections.abc import Callable
from contextvars import Context
from typing import Any

from orchestrator.clock import VirtualLoop

_SPARED = ("asyncio", "safety.guard", "tests.faults", "vehicles.embedded", "vehicles.links")
"""Of a killed orchestrator: what belongs to the guard, the vehicles, their links, and to us."""


class MortalLoop(VirtualLoop):
    """A dead task makes no step any more; only its cancellation reaches it, as in a hung one."""

    def __init__(self) -> None:
        super().__init__()
        self._dead: set[asyncio.Task[Any]] = set()
        self._spared: set[asyncio.Task[Any]] | None = None
        self._reached: set[asyncio.Task[Any]] = set()
        self.went_on: set[asyncio.Task[Any]] = set()
        """Who was dead until a time-out of its own: it was late, and then did its work."""
        self._kept: list[tuple[asyncio.Task[Any], Callable[..., object], tuple[Any, ...]]] = []

    def kill(self, tasks: set[asyncio.Task[Any]]) -> None:
        """Let tasks stand still from now on."""
        self._dead |= tasks
        self._sweep()

    def kill_all_but(self, spared: set[asyncio.Task[Any]]) -> None:
        """Let a process die: tasks and callbacks that are not the guard's or the vehicles'."""
        self._spared = spared
        self._sweep()

    def call_soon(
        self, callback: Any, *args: Any, context: Context | None = None
    ) -> asyncio.Handle:
        """Have it called in the next turn, unless it is dead."""
        if self._reached and (owner := getattr(callback, "__self__", None)) in self._reached:
            self.went_on.add(owner)
        handle = super().call_soon(callback, *args, context=context)
        if (self._dead or self._spared is not None) and self._is_dead(callback):
            self._bury(handle)
        return handle

    def call_at(
        self, when: float, callback: Any, *args: Any, context: Context | None = None
    ) -> asyncio.TimerHandle:
        """Have it called at a time, unless it is dead."""
        handle = super().call_at(when, callback, *args, context=context)
        if self._spared is not None and self._is_dead(callback):
            handle.cancel()
        return handle

    def _run_once(self) -> None:
        if self._kept:
            self._deliver_cancellations()
        super()._run_once()

    def _sweep(self) -> None:
        for handle in [*self._callbacks, *(timer for _, _, timer in self._timers)]:
            if not handle.cancelled() and self._is_dead(handle._callback):  # type: ignore[attr-defined]
                self._bury(handle)

    def _bury(self, handle: asyncio.Handle) -> None:
        callback, args = handle._callback, handle._args  # type: ignore[attr-defined]
        owner = getattr(callback, "__self__", None)
        if isinstance(owner, asyncio.Task):
            self._kept.append((owner, callback, args))
        handle.cancel()

    def _deliver_cancellations(self) -> None:
        if self._spared is not None:
            return
        for one in [one for one in self._kept if one[0].cancelling()]:
            self._kept.remove(one)
            self._dead.discard(one[0])
            self._reached.add(one[0])
            super().call_soon(one[1], *one[2])

    def _is_dead(self, callback: Any) -> bool:
        owner = getattr(callback, "__self__", None)
        if isinstance(owner, asyncio.Task):
            if self._spared is not None:
                return owner not in self._spared
            return owner in self._dead and not owner.cancelling()
        if self._spared is None:
            return False
        module = type(owner).__module__ if owner is not None else _module_of(callback)
        return not module.startswith(_SPARED) and module != "_asyncio"


def _module_of(callback: Any) -> str:
    inner = getattr(callback, "func", callback)
    return str(getattr(inner, "__module__", "") or "")
