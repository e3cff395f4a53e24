"""Identifies a process by its id and start time, since process ids are reused."""

import contextlib
import os
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import psutil

_END_S = 3.0
_POLL_S = 0.02
_ENDED = frozenset({psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD})


@dataclass(frozen=True, slots=True)
class ProcessId:
    """The identity of a process; started: hundredths of a second since boot."""

    pid: int
    started: int

    @classmethod
    def of(cls, pid: int) -> "ProcessId | None":
        """Return the identity of the process with this id now; None when there is none."""
        try:
            process = psutil.Process(pid)
            if process.status() in _ENDED:
                return None
            return cls(pid, _start_ticks(process))
        except psutil.Error:
            return None

    @classmethod
    def own(cls) -> "ProcessId":
        """Return this process's identity."""
        return cls(os.getpid(), _start_ticks(psutil.Process()))

    @property
    def lives(self) -> bool:
        """Return whether the identified process runs; a zombie does not."""
        return ProcessId.of(self.pid) == self

    def end(self, *, grace_s: float = _END_S) -> str:
        """End the identified process, child or not: SIGTERM, then SIGKILL; return which it took.

        Blocks for up to `grace_s` after each signal.
        """
        for number in (signal.SIGTERM, signal.SIGKILL):
            give_up_s = time.monotonic() + grace_s
            if self.lives:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(self.pid, number)
            while self.lives and time.monotonic() < give_up_s:
                time.sleep(_POLL_S)
            if not self.lives:
                return f"ended by {number.name}"
        return "it does not end, not even by SIGKILL"


def boot_id() -> str:
    """Return the identity of this boot of the machine; empty where unknown."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
    except OSError:
        return ""


def working_in(folder: Path) -> Iterator[ProcessId]:
    """Yield the processes whose working directory is a folder."""
    inside = str(folder.resolve())
    for process in psutil.process_iter(["cwd"]):
        if process.info["cwd"] == inside and (found := ProcessId.of(process.pid)) is not None:
            yield found


def process_group_lives(group: int) -> bool:
    """Return whether a process of a group runs; a zombie does not."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return any(_runs_in(group, pid) for pid in psutil.pids())


def _runs_in(group: int, pid: int) -> bool:
    try:
        return os.getpgid(pid) == group and psutil.Process(pid).status() not in _ENDED
    except (OSError, psutil.Error):
        return False


def _start_ticks(process: psutil.Process) -> int:
    """Return when a process started, in hundredths of a second since boot."""
    # psutil adds the boot time, which changes whenever the system clock is set.
    while True:
        boot_s = psutil.boot_time()
        started_s = process.create_time() - boot_s
        if psutil.boot_time() == boot_s:
            return round(100.0 * started_s)
