"""Whether the autonomy under test can be built: what it refuses is a fault of the file."""

import multiprocessing as mp
import sys
import threading
import time
from contextlib import redirect_stdout
from dataclasses import dataclass
from multiprocessing.connection import Connection

from campaigns.setup.autonomy_under_test import UnderTest
from campaigns.setup.external_reader import program_problems
from campaigns.values.references import BadReferenceError
from vehicles.process_memory import limited_allocation
from vehicles.processes.linux import processor_wait_s
from worlds.files.documents import Document, Path, Problem

LONGEST_BUILD_S = 30.0
"""How long an autonomy may take to be imported and built where it is tried in a child process; as
long as a worker may take to load it."""
_LONGEST_START_S = 120.0
"""A child process that has not begun by then never will, however busy the machine is."""
_GRACE_S = 1.0


@dataclass(frozen=True, slots=True)
class _Refusal:
    """Why an autonomy cannot be built; picklable. key: below `autonomy`, empty for all of it."""

    key: str
    message: str
    suggestion: str = ""


class IsolatedBuilds:
    """Builds autonomies in child processes to check them, each once for all cases.

    A child that takes longer than LONGEST_BUILD_S is ended.
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
        said = f"'{under_test.use}' cannot be built: {type(error).__name__}: {error}"
        return _Refusal("", said)
    return None


def _memory_refusal(under_test: UnderTest) -> _Refusal:
    """Return the refusal of an autonomy that asks for more memory than its limit."""
    limit = f"autonomy.limits.memory_mb, {under_test.limits.memory_mb:g}"
    said = f"'{under_test.use}' cannot be built: it asks for more memory than {limit}"
    return _Refusal("", f"{said}; let it load less, or raise the limit")


def _refusal_in_child(under_test: UnderTest) -> _Refusal | None:
    """Return why building the autonomy fails in a child process, hangs and crashes included."""
    # A fork has all of ours imported already; beside other threads it could inherit their locks.
    alone = threading.active_count() == 1
    context = mp.get_context("fork") if alone else mp.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    child = context.Process(target=_report, args=(theirs, under_test), name="autonomy check")
    child.start()
    theirs.close()
    try:
        # A child that is spawned imports all of ours first, which is not the autonomy's time.
        if ours.poll(_LONGEST_START_S):
            ours.recv()
        if not _is_answered_in_time(ours, child.pid or 0):
            said = f"is not imported and built within {LONGEST_BUILD_S:g} s: it blocks"
            return _Refusal("use", f"'{under_test.use}' {said}")
        found: _Refusal | None = ours.recv()
    except EOFError:
        child.join(_GRACE_S)
        said = f"ends its process (exit status {child.exitcode}) when it is imported or built"
        return _Refusal("use", f"'{under_test.use}' {said}")
    finally:
        child.kill()
        child.join()
        ours.close()
    return found


def _is_answered_in_time(connection: Connection, pid: int) -> bool:
    """Wait LONGEST_BUILD_S of a child's own time for its answer; return whether it came.

    On a busy machine a child may wait for a processor many times longer than it runs: a file is
    refused for what it does, not for what else the machine does.
    """
    end_s = time.monotonic() + LONGEST_BUILD_S - processor_wait_s(pid)
    while (left_s := end_s + processor_wait_s(pid) - time.monotonic()) > 0.0:
        if connection.poll(left_s):
            return True
    return False


def _report(connection: Connection, under_test: UnderTest) -> None:
    """Send that the autonomy check begins, and its outcome, from the child to its parent."""
    connection.send(None)
    with limited_allocation(under_test.limits.memory_mb):
        refusal = _refusal(under_test)
    connection.send(refusal)
    connection.close()
