"""Check that the autonomy under test can be built; what it refuses is a problem of the file."""

import multiprocessing as mp
import sys
import threading
from contextlib import redirect_stdout
from dataclasses import dataclass
from multiprocessing.connection import Connection

from campaigns.setup.autonomy_under_test import UnderTest
from campaigns.setup.external_reader import program_problems
from campaigns.values.references import BadReferenceError
from vehicles.process_memory import limited_allocation
from worlds.files.documents import Document, Path, Problem

LONGEST_BUILD_S = 30.0
"""How long a child process may take to import and build the autonomy; as long as a worker may take
to load it."""
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
    # A fork has our modules imported already, but next to other threads it could inherit a lock.
    alone = threading.active_count() == 1
    context = mp.get_context("fork") if alone else mp.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    child = context.Process(target=_report, args=(theirs, under_test), name="autonomy check")
    child.start()
    theirs.close()
    try:
        # A spawned child imports our modules first, which does not count as the autonomy's time.
        if not ours.poll(_LONGEST_START_S):
            message = f"could not be checked: no child process started in {_LONGEST_START_S:g} s"
            return _Refusal("use", f"'{under_test.use}' {message}; try again")
        ours.recv()
        if not ours.poll(LONGEST_BUILD_S):
            message = f"is not imported and built within {LONGEST_BUILD_S:g} s: it blocks"
            return _Refusal("use", f"'{under_test.use}' {message}")
        refusal: _Refusal | None = ours.recv()
    except EOFError:
        child.join(_GRACE_S)
        message = f"ends its process (exit status {child.exitcode}) when it is imported or built"
        return _Refusal("use", f"'{under_test.use}' {message}")
    finally:
        child.kill()
        child.join()
        ours.close()
    return refusal


def _report(connection: Connection, under_test: UnderTest) -> None:
    """Send that the autonomy check begins, and its outcome, from the child to its parent."""
    connection.send(None)
    with limited_allocation(under_test.limits.memory_mb):
        refusal = _refusal(under_test)
    connection.send(refusal)
    connection.close()
