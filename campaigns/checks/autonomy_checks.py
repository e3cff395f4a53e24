"""Check that the autonomy under test can be built; what it refuses is a problem of the file.

Find the keys of `autonomy.with` that an autonomy never asked for while it was built.
"""

import contextlib
import gc
import multiprocessing as mp
import sys
import threading
import time
import weakref
from collections.abc import Callable, Iterator, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.context import ForkContext, SpawnContext
from pathlib import Path as FilePath
from types import ModuleType

from wil_campaign.campaigns.setup.autonomy_under_test import UnderTest
from wil_campaign.campaigns.values.references import BadReferenceError
from wil_campaign.foundation.files.documents import Document, Path, Problem, closest_word
from wil_campaign.foundation.files.user_modules import keep_user_files, user_files
from wil_campaign.foundation.processes.interrupts import ctrl_c_blocked
from wil_campaign.foundation.processes.linux import processor_wait_s
from wil_campaign.foundation.processes.process_memory import limited_allocation

_OF_A_KEY = ("__getitem__", "__contains__", "get", "pop", "setdefault")
_OF_ALL = (
    "__iter__",
    "__reversed__",
    "__eq__",
    "__or__",
    "__ror__",
    "keys",
    "values",
    "items",
    "copy",
    "popitem",
)


class AskedKeys(dict[str, object]):
    """A dict that notes in `asked` the keys that were asked for, present or not.

    What looks at the whole dict (a loop, `**`, `dict(...)`) asks for every key.
    """

    def __init__(self, given: Mapping[str, object]) -> None:
        """given: the keys and values."""
        super().__init__(given)
        self.names = tuple(given)
        self.asked: set[object] = set()


def _noting(name: str, *, is_of_all: bool) -> Callable[..., object]:
    """Return the method of a dict that notes what is asked for before it answers."""
    plain: Callable[..., object] = getattr(dict, name)

    def method(asked_keys: AskedKeys, *arguments: object) -> object:
        asked_keys.asked.update(asked_keys.names if is_of_all else arguments[:1])
        return plain(asked_keys, *arguments)

    return method


for _name in (*_OF_A_KEY, *_OF_ALL):
    setattr(AskedKeys, _name, _noting(_name, is_of_all=_name in _OF_ALL))


def unread_keys(
    build: Callable[[dict[str, object]], object], parameters: Mapping[str, object]
) -> dict[str, str]:
    """Build an autonomy; return the keys that it never read, each with the key probably meant.

    Nothing is returned where it is not certain: where the autonomy keeps the dict, and so may read
    it in flight, and where it asked for no key at all, as compiled code reads a dict unseen.
    Raises whatever `build` raises.
    """
    given = AskedKeys(parameters)
    asked, kept = given.asked, weakref.ref(given)
    built = build(given)
    del given
    may_read_later = kept() is not None
    del built
    if may_read_later or not asked:
        return {}
    absent = [key for key in asked if isinstance(key, str) and key not in parameters]
    return {key: closest_word(key, sorted(absent)) for key in parameters if key not in asked}


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


@dataclass(frozen=True, slots=True)
class AutonomyTrial:
    """What came of building an autonomy once; picklable.

    refusal: why it cannot be built; None if it can. unread: the keys of `autonomy.with` that it
    never read, each with the key that was probably meant, or "".
    """

    refusal: _Refusal | None = None
    unread: Mapping[str, str] = field(default_factory=dict)


class _BlocksError(TimeoutError):
    """A child process has not imported and built the autonomy in time."""


class IsolatedBuilds:
    """Builds autonomies in child processes to check them, each once for all cases.

    A forked child that takes longer than a third of the autonomy's `build_s`, of LONGEST_BUILD_S at
    most, is ended; then a process that is not forked has the rest.
    """

    def __init__(self) -> None:
        self._trials: dict[str, AutonomyTrial] = {}

    def trial(self, under_test: UnderTest) -> AutonomyTrial:
        """Return what comes of building the autonomy in a child process."""
        key = repr(under_test)
        if key not in self._trials:
            self._trials[key] = _trial_in_child(under_test)
        return self._trials[key]


def try_autonomy(under_test: UnderTest, builds: IsolatedBuilds | None) -> AutonomyTrial:
    """Return what comes of building the autonomy once; builds=None: in this process.

    A foreign autonomy is not built.
    """
    if under_test.foreign is not None:
        return AutonomyTrial()
    return _trial(under_test) if builds is None else builds.trial(under_test)


def autonomy_problems(file: Document, under_test: UnderTest, trial: AutonomyTrial) -> list[Problem]:
    """Return the problems of an autonomy that was tried, or of a foreign one."""
    if under_test.foreign is not None:
        return under_test.foreign.problems(file, under_test.folder)
    refusal = trial.refusal
    if refusal is None:
        return []
    is_mapping = isinstance(file.get(("autonomy",)), dict)
    path: Path = ("autonomy", refusal.key) if refusal.key and is_mapping else ("autonomy",)
    return [file.problem(path, refusal.message, refusal.suggestion)]


def _trial(under_test: UnderTest) -> AutonomyTrial:
    """Return what comes of building this autonomy in this process."""
    try:
        with redirect_stdout(sys.stderr):
            unread = unread_keys(partial(under_test.build, 0), under_test.parameters)
    except (Exception, SystemExit) as error:  # noqa: BLE001 - the user's code may raise anything
        return AutonomyTrial(_refusal_of(under_test, error))
    return AutonomyTrial(unread=unread)


def _refusal_of(under_test: UnderTest, error: BaseException) -> _Refusal:
    """Return why an autonomy is refused whose building raised an error."""
    if isinstance(error, BadReferenceError) and not isinstance(error.__cause__, MemoryError):
        return _Refusal("use", str(error), error.suggestion)
    if isinstance(error, BadReferenceError | MemoryError):
        return _memory_refusal(under_test)
    if isinstance(error, ValueError):
        return _Refusal("with", f"refused by '{under_test.use}': {error}")
    message = f"'{under_test.use}' cannot be built: {type(error).__name__}: {error}"
    return _Refusal("", message)


def _memory_refusal(under_test: UnderTest) -> _Refusal:
    """Return the refusal of an autonomy that asks for more memory than its limit."""
    limit = f"autonomy.limits.memory_mb, {under_test.limits.memory_mb:g}"
    message = f"'{under_test.use}' cannot be built: it asks for more memory than {limit}"
    return _Refusal("", f"{message}; let it load less, or raise the limit")


def _trial_in_child(under_test: UnderTest) -> AutonomyTrial:
    """Return what comes of building the autonomy in a child process that may hang or crash."""
    # Both tries together end in the time that the pages name.
    limit_s = min(LONGEST_BUILD_S, under_test.limits.build_s)
    fork_s = limit_s / 3 if threading.active_count() == 1 else 0.0
    if fork_s > 0.0:
        # A fork has our modules imported already. It may wait for ever for a thread that Python
        # does not count, so its silence is no evidence against the autonomy.
        with contextlib.suppress(TimeoutError):
            fork = mp.get_context("fork")
            return _answer_of_child(fork, under_test, _LONGEST_FORK_S, fork_s)
    try:
        spawn = mp.get_context("spawn")
        return _answer_of_child(spawn, under_test, _LONGEST_SPAWN_S, limit_s - fork_s)
    except _BlocksError:
        message = f"'{under_test.use}' is not imported and built within {limit_s:g} s: it blocks"
        return AutonomyTrial(_Refusal("use", message))
    except TimeoutError as error:
        return AutonomyTrial(_Refusal("use", f"'{under_test.use}' {error}"))


def _answer_of_child(
    context: ForkContext | SpawnContext, under_test: UnderTest, start_s: float, build_s: float
) -> AutonomyTrial:
    """Return a child process's answer about the autonomy.

    Raises TimeoutError when it has not begun within `start_s`, _BlocksError when it has not
    answered `build_s` later.
    """
    ours, theirs = context.Pipe(duplex=False)
    child = context.Process(target=_report, args=(theirs, under_test), name="autonomy check")
    is_fork = isinstance(context, ForkContext)
    hidden = contextlib.nullcontext() if is_fork else _main_hidden()
    with _garbage_kept(), hidden, ctrl_c_blocked():
        child.start()
    theirs.close()
    try:
        # A spawned child imports our modules first, which does not count as the autonomy's time.
        if not _is_answered(ours, child.pid or 0, start_s):
            message = f"could not be checked: no child process started in {start_s:g} s; try again"
            raise TimeoutError(message)
        ours.recv()
        if not _is_answered(ours, child.pid or 0, build_s):
            raise _BlocksError
        trial: AutonomyTrial = ours.recv()
        files: dict[FilePath, str] = ours.recv()
    except EOFError:
        child.join(_GRACE_S)
        ended = f"ends its process (exit status {child.exitcode}) when it is imported or built"
        return AutonomyTrial(_Refusal("use", f"'{under_test.use}' {ended}"))
    finally:
        child.kill()
        child.join()
        ours.close()
    if under_test.code_folder is not None:
        keep_user_files(under_test.code_folder, files)
    return trial


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
        trial = _trial(under_test)
    connection.send(trial)
    folder = under_test.code_folder
    connection.send({} if folder is None else user_files(folder))
    connection.close()
