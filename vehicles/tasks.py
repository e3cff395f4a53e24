"""Tasks whose end somebody sees: the one module of ours that creates them.

Every task of a loop stands in the `TaskAccount` of that loop. It ends in the way it was asked to:
it returns, or it is cancelled by somebody who asked for that. Anything else is a fault: an
exception that nobody expects, one that nobody reads, a cancellation that nobody asked for, and a
task that still runs when all should be over.
"""

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

T = TypeVar("T")

FAULTS = (Exception, asyncio.CancelledError)
"""What code that does not await may raise by mistake; Ctrl-C and SystemExit are none."""

_OURS = tuple(
    str(Path(__file__).parents[1] / name)
    for name in ("campaigns", "orchestrator", "recipes", "safety", "vehicles", "worlds")
)

TakeFault = Callable[[BaseException, str], None]
"""Takes an exception and where it arose."""


def start(coroutine: Coroutine[Any, Any, T], *, name: str) -> asyncio.Task[T]:
    """Start a task beside the caller, which has to `stop` or await it."""
    return asyncio.get_running_loop().create_task(coroutine, name=name)


async def stop(*tasks: asyncio.Task[Any]) -> None:
    """Cancel tasks and wait until all have ended. Raises another error that ended one of them."""
    for task in tasks:
        task.cancel()
    if tasks:
        await asyncio.wait(tasks)
    errors = [error for task in tasks if not task.cancelled() and (error := task.exception())]
    if errors:
        raise _one_of(errors)


async def finish(coroutine: Coroutine[Any, Any, T], *, name: str) -> T:
    """Run a coroutine to its end in its own task, whatever happens to the caller meanwhile.

    A cancellation of the caller, however often, is raised when the task has ended.
    """
    task = start(coroutine, name=name)
    interruptions: list[BaseException] = []
    while not task.done():
        try:
            await asyncio.wait([task])
        except BaseException as error:  # noqa: BLE001 - it is raised below
            interruptions.append(error)
    if interruptions:
        if not task.cancelled() and (failure := task.exception()) is not None:
            raise failure from interruptions[0]
        raise interruptions[0]
    return task.result()


@asynccontextmanager
async def together() -> AsyncIterator[asyncio.TaskGroup]:
    """Open a group of tasks (TaskGroup) that raises a single error as it is, in no group."""
    try:
        async with asyncio.TaskGroup() as group:
            yield group
    except BaseExceptionGroup as errors:
        raise _one_of(leaves(errors)) from None


def leaves(error: BaseException) -> list[BaseException]:
    """Return the errors within error groups of tasks, the first one first."""
    if isinstance(error, BaseExceptionGroup):
        return [leaf for one in error.exceptions for leaf in leaves(one)]
    return [error]


def asked_to_end(error: BaseException) -> bool:
    """Return whether an error is a requested cancellation of this task."""
    if not isinstance(error, asyncio.CancelledError):
        return False
    task = asyncio.current_task()
    return task is not None and task.cancelling() > 0


def report(error: BaseException, where: str) -> None:
    """Report a task's exception to the loop's exception handler.

    For callbacks that have to go on: one listener that fails must not keep the others from what
    they have to know.
    """
    context = {"message": where, "exception": error}
    asyncio.get_running_loop().call_exception_handler(context)


class Contained:
    """Reports exceptions raised within it, and goes on; a context manager for plain code."""

    __slots__ = ("_where",)

    def __init__(self, where: str) -> None:
        self._where = where

    def __enter__(self) -> None:
        """Start to contain exceptions."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> bool:
        """Report an exception of ours to the loop's handler."""
        if not isinstance(error, FAULTS):
            return False
        report(error, self._where)
        return True


class TaskAccount:
    """Accounts for every task that its loop starts, except in other people's packages.

    fault: told at once of a task that ended in another way than it was asked to, with its name.
    expected: errors that the task's starter knows what to do with; they are faults only when nobody
    has read them at the end.
    """

    def __init__(self, *, fault: TakeFault, expected: tuple[type[BaseException], ...] = ()) -> None:
        self._fault = fault
        self._expected = expected
        self._running: set[asyncio.Task[Any]] = set()
        self._unread: list[asyncio.Task[Any]] = []

    @contextmanager
    def of(self, loop: asyncio.AbstractEventLoop) -> Iterator[None]:
        """Account for all tasks started meanwhile; at the end all must be over."""
        before = loop.get_task_factory()
        loop.set_task_factory(self._start_task)
        try:
            yield
        finally:
            loop.set_task_factory(before)
            self._close()

    def _start_task(
        self, loop: asyncio.AbstractEventLoop, coroutine: Any, **more: Any
    ) -> asyncio.Task[Any]:
        task: asyncio.Task[Any] = asyncio.Task(coroutine, loop=loop, **more)
        if not _is_library(coroutine):
            self._running.add(task)
            task.add_done_callback(self._on_task_end)
        return task

    def _on_task_end(self, task: asyncio.Task[Any]) -> None:
        self._running.discard(task)
        if task.cancelled():
            if not task.cancelling():
                self._fault(_cancellation_of(task), task.get_name())
            return
        error: BaseException | None = _peek(task, "_exception")
        if error is None:
            return
        if all(isinstance(one, self._expected) for one in leaves(error)):
            self._unread.append(task)
        else:
            self._fault(error, task.get_name())

    def _close(self) -> None:
        for task in self._unread:
            if _peek(task, "_log_traceback") and (error := task.exception()) is not None:
                self._fault(error, task.get_name())
        for task in sorted(self._running, key=lambda one: one.get_name()):
            if task.done():
                self._on_task_end(task)
            else:
                text = f"the task {task.get_name()} still runs after the end"
                self._fault(RuntimeError(text), task.get_name())


def _peek(task: asyncio.Task[Any], name: str) -> Any:
    """Return an attribute of a task of asyncio's: `exception()` would count as having read it."""
    return getattr(task, name)


def _is_library(coroutine: Any) -> bool:
    """Return whether a task's coroutine is of an installed package that is none of ours.

    Who calls such a package awaits what it starts, and learns of its errors by what it raises.
    """
    code = getattr(coroutine, "cr_code", None)
    path = "" if code is None else str(code.co_filename)
    return "site-packages" in path and not path.startswith(_OURS)


def _cancellation_of(task: asyncio.Task[Any]) -> BaseException:
    """Return the CancelledError of a cancelled task."""
    try:
        task.result()
    except asyncio.CancelledError as error:
        return error
    raise AssertionError(task)


def _one_of(errors: list[BaseException]) -> BaseException:
    """Return the only error of tasks, or all in a group."""
    return errors[0] if len(errors) == 1 else BaseExceptionGroup("several tasks failed", errors)
