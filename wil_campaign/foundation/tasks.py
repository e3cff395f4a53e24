"""Creates asyncio tasks, and accounts for them: no task ends or outlives its loop unnoticed.

Every task of a loop is in the `TaskAccount` of that loop. It ends as requested: it returns, or it
is cancelled by a request. Anything else is a fault: an unexpected exception, one that is never
read, a cancellation without a request, and a task that still runs at the end.
"""

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

T = TypeVar("T")

FAULTS = (Exception, asyncio.CancelledError)
"""Faults of code that does not await; Ctrl-C and SystemExit are none."""

_OURS = str(Path(__file__).parents[1])

TakeFault = Callable[[BaseException, str], None]
"""Takes an exception and where it arose."""


def start_task(coroutine: Coroutine[Any, Any, T], *, name: str) -> asyncio.Task[T]:
    """Start a task, which the caller has to `stop` or await."""
    return asyncio.get_running_loop().create_task(coroutine, name=name)


async def stop_tasks(*tasks: asyncio.Task[Any]) -> None:
    """Cancel tasks and wait until all have ended. Raises another error that ended one of them."""
    for task in tasks:
        task.cancel()
    if tasks:
        await asyncio.wait(tasks)
    errors = [error for task in tasks if not task.cancelled() and (error := task.exception())]
    if errors:
        raise _one_of(errors)


async def finish_in_task(coroutine: Coroutine[Any, Any, T], *, name: str) -> T:
    """Run a coroutine to its end in its own task, whatever happens to the caller meanwhile.

    A cancellation of the caller, however often, is raised when the task has ended. A loop that is
    gone ends no task: then nothing is waited for.
    """
    task = start_task(coroutine, name=name)
    interruptions: list[BaseException] = []
    while not task.done():
        try:
            await asyncio.wait([task])
        except GeneratorExit:
            raise
        except BaseException as error:  # noqa: BLE001 - it is raised below
            interruptions.append(error)
    if interruptions:
        if not task.cancelled() and (failure := task.exception()) is not None:
            raise failure from interruptions[0]
        raise interruptions[0]
    return task.result()


@asynccontextmanager
async def open_task_group() -> AsyncIterator[asyncio.TaskGroup]:
    """Open a group of tasks (TaskGroup) that raises a single error as it is, in no group."""
    try:
        async with asyncio.TaskGroup() as group:
            yield group
    except BaseExceptionGroup as errors:
        raise _one_of(leaf_errors(errors)) from None


@contextmanager
def raising_first_task_error(*kinds: type[Exception]) -> Iterator[None]:
    """Raise the first error of these kinds in a group of tasks' errors by itself, in no group.

    Where there are also errors of other kinds, a group of it and them. Not by `except*`: what is
    raised there arrives in a group before Python 3.11.4, and Debian 12 has 3.11.2.
    """
    try:
        yield
    except BaseExceptionGroup as errors:
        found, others = errors.split(kinds)
        if found is None:
            raise
        first = leaf_errors(found)[0]
        if others is None:
            raise first from None
        raise BaseExceptionGroup(errors.message, [first, others]) from None


def leaf_errors(error: BaseException) -> list[BaseException]:
    """Return the errors within nested error groups of tasks, in order."""
    if isinstance(error, BaseExceptionGroup):
        return [leaf for exception in error.exceptions for leaf in leaf_errors(exception)]
    return [error]


def is_task_cancellation(error: BaseException) -> bool:
    """Return whether an error is a requested cancellation of this task."""
    if not isinstance(error, asyncio.CancelledError):
        return False
    task = asyncio.current_task()
    return task is not None and task.cancelling() > 0


def raise_if_task_cancelled() -> None:
    """Raise CancelledError if this task was cancelled and went on.

    For the line after a library's `asyncio.wait_for`: in Python 3.11 that drops a cancellation in
    the moment in which what it awaits is done, and the task would never end. Not in a task in which
    a TaskGroup has failed: in Python 3.11 that counts as cancelled ever after.
    """
    task = asyncio.current_task()
    if task is not None and task.cancelling():
        raise asyncio.CancelledError


def report_task_error(error: BaseException, where: str) -> None:
    """Report a task's exception to the loop's exception handler.

    For callers of several callbacks: one listener that fails must not keep the others from being
    called.
    """
    context = {"message": where, "exception": error}
    asyncio.get_running_loop().call_exception_handler(context)


class SuppressedErrors:
    """Reports exceptions raised within it and suppresses them; a context manager.

    later: once what runs now has ended, so that what it decides comes first.
    """

    __slots__ = ("_is_later", "_where")

    def __init__(self, where: str, *, later: bool = False) -> None:
        self._where = where
        self._is_later = later

    def __enter__(self) -> None:
        """Start to contain exceptions."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> bool:
        """Report an exception of FAULTS to the loop's handler."""
        if not isinstance(error, FAULTS):
            return False
        if self._is_later:
            asyncio.get_running_loop().call_soon(report_task_error, error, self._where)
        else:
            report_task_error(error, self._where)
        return True


class TaskAccount:
    """Accounts for every task that its loop starts, except those of installed packages.

    fault: called at once with the error and name of a task that ended otherwise than requested.
    expected: errors that the task's starter handles; they are faults only when they have not been
    read at the end.
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
        if all(isinstance(leave, self._expected) for leave in leaf_errors(error)):
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
    """Return a private attribute of a task: `exception()` would mark its error as read."""
    return getattr(task, name)


def _is_library(coroutine: Any) -> bool:
    """Return whether a task's coroutine is of an installed package other than this program.

    Callers of such a package await its tasks, and get their errors as exceptions.
    """
    code = getattr(coroutine, "cr_code", None)
    path = "" if code is None else str(code.co_filename)
    return "site-packages" in path and not path.startswith(_OURS)


def _cancellation_of(task: asyncio.Task[Any]) -> BaseException:
    try:
        task.result()
    except asyncio.CancelledError as error:
        return error
    raise AssertionError(task)


def _one_of(errors: list[BaseException]) -> BaseException:
    return errors[0] if len(errors) == 1 else BaseExceptionGroup("several tasks failed", errors)
