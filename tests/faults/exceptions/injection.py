"""Finds by instrumentation where a run can raise, and raises there.

A run is flown once under `InjectingLoop`: each step of each task and each callback of ours is a
point, by the name of its task, the lines of our packages that wait, and the stage of the run. Then
one is flown for each point, with an exception in place of what the line waited for.
"""

import asyncio
import inspect
import sys
from collections.abc import Callable, Coroutine, Generator, Iterator
from contextlib import ExitStack, contextmanager
from contextvars import Context
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, Literal, TypeVarTuple
from unittest import mock

from wil_campaign.foundation.clocks.virtual_loop import VirtualLoop

_Ts = TypeVarTuple("_Ts")

ROOT = Path(__file__).parents[3]
PACKAGES = ("campaigns", "orchestrator", "plugins", "recipes", "safety", "vehicles", "worlds")
_HOME = f"{ROOT / 'wil_campaign'}/"
_OURS = tuple(f"{_HOME}{name}/" for name in PACKAGES)
"""Where our code is by the name by which it is imported; places are told without it."""
_ASYNC = inspect.CO_COROUTINE | inspect.CO_GENERATOR | inspect.CO_ASYNC_GENERATOR

_OF_PROTOCOLS = {
    "connection_made",
    "connection_lost",
    "data_received",
    "datagram_received",
    "error_received",
}

Kind = Literal["await", "callback", "call"]


class InjectedError(Exception):
    """What is raised: no code of ours knows it, so nobody can mean to catch it."""


@dataclass(frozen=True, slots=True, order=True)
class Point:
    """A place in the run where an exception can come up.

    task: its name; where: the lines of ours that wait, outermost first, or the function that is
    called; stage: of the run.
    """

    kind: Kind
    task: str
    where: str
    stage: str


@dataclass(frozen=True, slots=True)
class Injection:
    """What is raised at which point, at its how many-th time (from 1)."""

    point: Point
    nth: int
    error: Literal["exception", "cancelled"] = "exception"

    def make(self) -> BaseException:
        """Return the exception."""
        text = f"injected at {self.point.where}"
        if self.error == "cancelled":
            return asyncio.CancelledError(text)
        return InjectedError(text)


@dataclass(slots=True)
class Probe:
    """Counts the points of a run; at the wanted one it has something raised."""

    injection: Injection | None = None
    stage: Callable[[], str] = lambda: "opening"
    counts: dict[Point, int] = field(default_factory=dict)
    raised: bool = False

    def pass_by(self, point: Point) -> BaseException | None:
        """Return what is to be raised at a point, which the run has come to."""
        count = self.counts[point] = self.counts.get(point, 0) + 1
        wanted = self.injection
        if self.raised or wanted is None or (point, count) != (wanted.point, wanted.nth):
            return None
        task = asyncio.current_task()
        if wanted.error == "cancelled" and task is not None and task.cancelling():
            return None  # It has been asked to end by that very exception.
        self.raised = True
        return wanted.make()


class _Stepped(Coroutine[Any, Any, Any]):
    """A task's coroutine, each step of which passes by the probe."""

    def __init__(self, inner: Coroutine[Any, Any, Any], probe: Probe) -> None:
        self._inner = inner
        self._probe = probe

    def send(self, value: Any) -> Any:
        where = waiting_at(self._inner)
        if where:
            point = Point("await", _task_name(), where, self._probe.stage())
            error = self._probe.pass_by(point)
            if error is not None:
                return self._inner.throw(error)
        return self._inner.send(value)

    def throw(self, *raised: Any) -> Any:
        return self._inner.throw(*raised)

    def close(self) -> None:
        self._inner.close()

    def __await__(self) -> Generator[Any, Any, Any]:
        raise NotImplementedError

    @property
    def cr_code(self) -> CodeType | None:
        """What it runs: who accounts for tasks tells those of libraries by it."""
        return getattr(self._inner, "cr_code", None)


class _Injecting(asyncio.BaseEventLoop):
    """What makes the tasks and callbacks of a loop pass by a probe."""

    def __init__(self, probe: Probe) -> None:
        self._probe = probe
        super().__init__()

    def create_task(self, coro: Any, **more: Any) -> asyncio.Task[Any]:
        """Have each of its steps pass by the probe."""
        return super().create_task(_Stepped(coro, self._probe), **more)

    def call_soon(
        self, callback: Callable[[*_Ts], object], *args: *_Ts, context: Context | None = None
    ) -> asyncio.Handle:
        return super().call_soon(self._passing(callback), *args, context=context)

    def call_at(
        self,
        when: float,
        callback: Callable[[*_Ts], object],
        *args: *_Ts,
        context: Context | None = None,
    ) -> asyncio.TimerHandle:
        return super().call_at(when, self._passing(callback), *args, context=context)

    def _passing(self, callback: Any) -> Any:
        return _passing(callback, self._probe)


class InjectingLoop(_Injecting, VirtualLoop):
    """Virtual time in which tasks and callbacks pass by a probe."""


class InjectingWallLoop(_Injecting, asyncio.SelectorEventLoop):
    """The wall's time; what is called for a socket, a pipe or a process passes by too."""

    def _add_reader(self, fd: Any, callback: Any, *args: Any) -> asyncio.Handle:
        added: asyncio.Handle = super()._add_reader(fd, self._passing(callback), *args)  # type: ignore[misc]  # asyncio's own
        return added


def _passing(callback: Any, probe: Probe) -> Any:
    """Return a callback of ours that raises when it has done its work, where that is wanted."""
    code = _code_of(callback)
    if code is None or not code.co_filename.startswith(_OURS):
        return callback
    where = _place(code, code.co_firstlineno)

    def called(*args: Any) -> None:
        callback(*args)
        error = probe.pass_by(Point("callback", "loop", where, probe.stage()))
        if error is not None:
            raise error

    # Ours, for what tells our errors from those of the autonomy's own callbacks by their file.
    called.__code__ = called.__code__.replace(co_filename="<injection>")
    return called


@contextmanager
def protocols_pass_by(probe: Probe) -> Iterator[None]:
    """Have what asyncio calls of our protocols, for bytes that came, pass by the probe."""
    with ExitStack() as stack:
        for kind in _protocols(asyncio.BaseProtocol):
            for name in _OF_PROTOCOLS & vars(kind).keys():
                method = _passing(vars(kind)[name], probe)
                stack.enter_context(mock.patch.object(kind, name, method))
        yield


def _protocols(kind: type[Any]) -> Iterator[type[Any]]:
    for one in kind.__subclasses__():
        yield one
        yield from _protocols(one)


def waiting_at(coroutine: Any) -> str:
    """Return the lines of ours at which a coroutine waits, outermost first."""
    places = []
    while coroutine is not None:
        frame, inner = _frame_of(coroutine)
        if frame is not None and frame.f_code.co_filename.startswith(_OURS):
            places.append(_place(frame.f_code, frame.f_lineno))
        coroutine = inner
    return " > ".join(places)


def _frame_of(one: Any) -> tuple[FrameType | None, Any]:
    for prefix, inner in (("cr", "cr_await"), ("gi", "gi_yieldfrom"), ("ag", "ag_await")):
        if hasattr(one, f"{prefix}_frame"):
            return getattr(one, f"{prefix}_frame"), getattr(one, inner)
    return None, None


def _code_of(callback: Any) -> CodeType | None:
    while isinstance(callback, partial):
        callback = callback.func
    code = getattr(callback, "__code__", None)
    return code if isinstance(code, CodeType) else None


def _place(code: CodeType, line: int) -> str:
    path = code.co_filename.removeprefix(_HOME)
    return f"{path}:{line} {code.co_qualname}"


def _task_name() -> str:
    task = asyncio.current_task()
    name = "" if task is None else task.get_name()
    return "unnamed" if not name or name.startswith("Task-") else name


@contextmanager
def calls_pass_by(probe: Probe, *, but: tuple[str, ...] = ()) -> Iterator[None]:
    """Have each call of a plain function of ours pass by the probe, which may raise in its place.

    but: folders and files whose functions are left out.
    """
    left_out = tuple(f"{_HOME}{one}" for one in but)
    known: dict[CodeType, str] = {}
    found: set[tuple[CodeType, str]] = set()
    wanted = probe.injection

    def entered(frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        where = known.get(code)
        if where is None:
            ours = code.co_filename.startswith(_OURS) and not code.co_filename.startswith(left_out)
            plain = ours and not code.co_flags & _ASYNC and not code.co_name.startswith("<")
            where = known[code] = _place(code, code.co_firstlineno) if plain else ""
        if not where or event != "call" or (wanted is not None and wanted.point.where != where):
            return
        stage = probe.stage()
        if wanted is None:
            # A million calls: each point is counted once, for nothing asks how often it came.
            if (code, stage) in found:
                return
            found.add((code, stage))
        error = probe.pass_by(Point("call", "", where, stage))
        if error is not None:
            raise error

    sys.settrace(entered)
    try:
        yield
    finally:
        sys.settrace(None)
