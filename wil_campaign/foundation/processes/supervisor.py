"""Runs one program and ends it, with all its descendants, on a signal or when its parent ends.

A program of its own: `python -m wil_campaign.foundation.processes.supervisor PARENT SECONDS FOLDER
PROGRAM ARGUMENT...`, see `supervised`. It survives the orchestrator's death, and adopts descendants
that moved into a session of their own, so that it can end them, too.
"""

import contextlib
import os
import select
import signal
import sys
import time
from collections.abc import Sequence

import psutil

from wil_campaign.foundation.processes.linux import adopt_orphans, die_with_parent

_ENDING = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
_NOT_STARTED = 127
_SOON_S = 0.05


def supervised_command(
    argv: Sequence[str], *, parent: int, grace_s: float, folder: str = ""
) -> tuple[str, ...]:
    """Return the command that runs a program under a supervisor.

    parent: the id of the process that runs the command, whose end ends the program; 0 for the end
    of its stdin instead. grace_s: how long the program may take to end after SIGTERM. folder: its
    working directory, with its output in `output.txt`; empty to inherit both.
    """
    supervisor = (sys.executable, "-P", "-m", "wil_campaign.foundation.processes.supervisor")
    return (*supervisor, str(parent), f"{grace_s:g}", folder, *argv)


class ProcessSupervisor:
    """The supervisor of a program: waits for its end or a signal, and ends its processes."""

    def __init__(self, *, argv: list[str], grace_s: float, lifeline: int | None) -> None:
        self._grace_s = grace_s
        self._lifeline = lifeline
        self._status: int | None = None
        self._wakeups, waker = os.pipe()
        for end in (self._wakeups, waker):
            os.set_blocking(end, False)
        signal.set_wakeup_fd(waker, warn_on_full_buffer=False)
        for number in (*_ENDING, signal.SIGCHLD):
            signal.signal(number, _ignore_signal)
        self._main = _start(argv)

    def run(self) -> int:
        """Supervise until the program ends or has to end; return its exit code as shells do."""
        ending = False
        while self._status is None and not ending:
            ending = self._wait(1.0)
            self._reap()
        self._end()
        code = _NOT_STARTED if self._status is None else os.waitstatus_to_exitcode(self._status)
        return 128 - code if code < 0 else code

    def _wait(self, seconds: float) -> bool:
        """Wait for any signal; return whether one, or the end of stdin, ends the supervisor."""
        watched = [self._wakeups] if self._lifeline is None else [self._wakeups, self._lifeline]
        ready, _, _ = select.select(watched, [], [], seconds)
        if self._lifeline in ready and not os.read(self._lifeline, 4096):
            self._lifeline = None
            return True
        try:
            came = os.read(self._wakeups, 4096)
        except BlockingIOError:
            return False
        return any(number in came for number in _ENDING)

    def _reap(self) -> bool:
        """Reap the supervised children; return whether any lives."""
        while True:
            try:
                pid, status = os.waitpid(-1, os.WNOHANG)
            except ChildProcessError:
                return False
            if pid == 0:
                return True
            if pid == self._main:
                self._status = status

    def _end(self) -> None:
        """End all supervised processes: SIGTERM, then SIGKILL until no child is left."""
        self._signal(signal.SIGTERM)
        begin_s = time.monotonic()
        while alive := self._reap():
            if time.monotonic() - begin_s >= self._grace_s:
                break
            self._wait(_SOON_S)
        while alive:
            self._signal(signal.SIGKILL)
            self._wait(_SOON_S)
            alive = self._reap()

    def _signal(self, number: signal.Signals) -> None:
        """Signal the supervised program's process group, and processes that left it."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._main, number)
        for pid in _children():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, number)


def _ignore_signal(*_: object) -> None:
    """Do nothing: the supervisor reads the signal's number from its pipe."""


def _start(argv: list[str]) -> int:
    """Start the supervised program in its own process group; return its process id."""
    supervisor = os.getpid()
    pid = os.fork()
    if pid:
        return pid
    try:
        signal.set_wakeup_fd(-1)
        os.setpgid(0, 0)
        die_with_parent(signal.SIGKILL)
        if os.getppid() == supervisor:
            os.execvp(argv[0], argv)  # noqa: S606 - the program that was asked for, without a shell
    except OSError as error:
        os.write(2, f"{argv[0]}: {error.strerror}\n".encode())
    finally:
        os._exit(_NOT_STARTED)


def _children() -> list[int]:
    return [child.pid for child in psutil.Process().children()]


def main(arguments: list[str]) -> int:
    """Supervise a program as the arguments say; return its exit code."""
    parent, grace_s, folder = int(arguments[0]), float(arguments[1]), arguments[2]
    if folder:
        _write_to(folder)
    lifeline = None if parent else os.dup(0)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    adopt_orphans()
    if parent:
        die_with_parent(signal.SIGTERM)
        if os.getppid() != parent:
            # The parent ended before the call.
            return _NOT_STARTED
    return ProcessSupervisor(argv=arguments[3:], grace_s=grace_s, lifeline=lifeline).run()


def _write_to(folder: str) -> None:
    """Change the supervisor's working folder, and redirect its output to a file there."""
    os.chdir(folder)
    output = os.open("output.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND, 0o644)
    for stream in (1, 2):
        os.dup2(output, stream)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
