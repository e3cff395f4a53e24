"""Check that the autonomy under test can be built; what it refuses is a problem of the file."""

import contextlib
import gc
import multiprocessing as mp
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import redirect_stdout
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.context import ForkContext, SpawnContext
from types import ModuleType

from campaigns.setup.autonomy_under_test import UnderTest
from campaigns.setup.external_reader import program_problems
from campaigns.values.references import BadReferenceError
from vehicles.process_memory import limited_allocation
from vehicles.processes.linux import processor_wait_s
from worlds.files.documents import Document, Path, Problem

LONGEST_BUILD_S = 30.0
"""How long an autonomy may take to be imported and built where it is tried in a child process; as
long as a worker may take to load it. Time for which the child has no processor does not count."""
_LONGEST_SPAWN_S, _LONGEST_FORK_S = 120.0, 5.0
"""A child process that has not begun by then never will."""
_GRACE_S = 1.0
_MAIN_LOCK = threading.Lock()
"""Files may be checked in several threads."""


@dataclass(frozen=True, slots=True)
class _Refusal:
    """Why an autonomy cannot be built; picklable. key: below `autonomy`, empty for all of it."""

    key: str
    message: str
    suggestion: str = ""


class IsolatedBuilds:
    """Builds autonomies in child processes to check them, each once for all cases.

    A child that takes longer than LONGEST_BUILD_S is ended; a fork sooner; then a process is
    tried that is not forked.
    """

    def __init__(self) -> None:
        self._refusals: dict[str, _Refusal | None] = {}

    def refusal(self, under_test: UnderTest) -> _Refusal | None:
        """Return why the autonomy cannot be built in a child process; None if it can."""
        key = repr(under_test)
        if key not in self._refusals:
            self._refusals[key] = _refusal_in_child(under_test)
        return self._refusals[key]


def autonomy_problems(
    campaign: Document, under_test: UnderTest, builds: IsolatedBuilds | None
) -> list[Problem]:
    """Return the problems found by building the autonomy once; builds=None: in this process."""
    if under_test.program is not None:
        return program_problems(campaign, under_test.program, under_test.folder)
    refusal = _refusal(under_test) if builds is None else builds.refusal(under_test)
    if refusal is None:
        return []
    is_mapping = isinstance(campaign.get(("autonomy",)), dict)
    path: Path = ("autonomy", refusal.key) if refusal.key and is_mapping else ("autonomy",)
    return [campaign.problem(path, refusal.message, refusal.suggestion)]


def _refusal(under_test: UnderTest) -> _Refusal | None:
    """Return why building this autonomy fails in this process; None if it works."""
    try:
        with redirect_stdout(sys.stderr):
            under_test.build(seed=0)
    except BadReferenceError as error:
        if isinstance(error.__cause__, MemoryError):
            return _memory_refusal(under_test)
        return _Refusal("use", str(error), error.suggestion)
    except ValueError as error:
        return _Refusal("with", f"refused by '{under_test.use}': {error}")
    except MemoryError:
        return _memory_refusal(under_test)
    except (Exception, SystemExit) as error:  # noqa: BLE001 - the user's code may raise anything
        message = f"'{under_test.use}' cannot be built: {type(error).__name__}: {error}"
        return _Refusal("", message)
    return None


def _memory_refusal(under_test: UnderTest) -> _Refusal:
    """Return the refusal of an autonomy that asks for more memory than its limit."""
    limit = f"autonomy.limits.memory_mb, {under_test.limits.memory_mb:g}"
    message = f"'{under_test.use}' cannot be built: it asks for more memory than {limit}"
    return _Refusal("", f"{message}; let it load less, or raise the limit")


def _refusal_in_child(under_test: UnderTest) -> _Refusal | None:
    """Return why building the autonomy fails in a child process, hangs and crashes included."""
    if threading.active_count() == 1:
        # A fork has our modules imported already. It may wait for ever for a thread that Python
        # does not count, so its silence is no evidence against the autonomy.
        with contextlib.suppress(TimeoutError):
            fork = mp.get_context("fork")
            return _answer_of_child(fork, under_test, _LONGEST_FORK_S, LONGEST_BUILD_S / 3)
    try:
        spawn = mp.get_context("spawn")
        return _answer_of_child(spawn, under_test, _LONGEST_SPAWN_S, LONGEST_BUILD_S)
    except TimeoutError as error:
        return _Refusal("use", f"'{under_test.use}' {error}")


def _answer_of_child(
    context: ForkContext | SpawnContext, under_test: UnderTest, start_s: float, build_s: float
) -> _Refusal | None:
    """Return a child process's answer about the autonomy.

    Raises TimeoutError when it has not begun within `start_s`, or not answered `build_s` later.
    """
    ours, theirs = context.Pipe(duplex=False)
    child = context.Process(target=_report, args=(theirs, under_test), name="autonomy check")
    is_fork = isinstance(context, ForkContext)
    with _garbage_kept(), contextlib.nullcontext() if is_fork else _main_hidden():
        child.start()
    theirs.close()
    try:
        # A spawned child imports our modules first, which does not count as the autonomy's time.
        if not _is_answered(ours, child.pid or 0, start_s):
            message = f"could not be checked: no child process started in {start_s:g} s; try again"
            raise TimeoutError(message)
        ours.recv()
        if not _is_answered(ours, child.pid or 0, build_s):
            raise TimeoutError(f"is not imported and built within {build_s:g} s: it blocks")
        refusal: _Refusal | None = ours.recv()
    except EOFError:
        child.join(_GRACE_S)
        ended = f"ends its process (exit status {child.exitcode}) when it is imported or built"
        return _Refusal("use", f"'{under_test.use}' {ended}")
    finally:
        child.kill()
        child.join()
        ours.close()
    return refusal


@contextlib.contextmanager
def _garbage_kept() -> Iterator[None]:
    """Suspend garbage collection, also in a child that is forked meanwhile.

    An object of this process may end its own threads when it is freed (FFmpeg's scaler does). A
    fork does not have these threads, and would wait for them for ever.
    """
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


@contextlib.contextmanager
def _main_hidden() -> Iterator[None]:
    """Keep a child that is spawned meanwhile from running the program of this process again.

    `multiprocessing` runs the file of `__main__` in it first, for what it may be sent from there:
    of a program without `if __name__ == "__main__"` that would be all it does, flights included.
    """
    with _MAIN_LOCK:
        main = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            yield
        finally:
            sys.modules["__main__"] = main


def _is_answered(connection: Connection, pid: int, limit_s: float) -> bool:
    """Wait for a child's answer, `limit_s` of its own time; return whether it came.

    On a busy machine a child may wait for a processor many times longer than it runs: a file is
    refused for what it does, not for what else the machine does.
    """
    end_s = time.monotonic() + limit_s - processor_wait_s(pid)
    while (left_s := end_s + processor_wait_s(pid) - time.monotonic()) > 0.0:
        if connection.poll(left_s):
            return True
    return False


def _report(connection: Connection, under_test: UnderTest) -> None:
    """Send that the autonomy check begins, and its outcome, from the child to its parent."""
    gc.freeze()  # see _garbage_kept
    gc.enable()
    connection.send(None)
    with limited_allocation(under_test.limits.memory_mb):
        refusal = _refusal(under_test)
    connection.send(refusal)
    connection.close()
