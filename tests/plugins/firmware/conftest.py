"""Simulators that are none: small programs that say and do what the real ones do at their start."""

import fcntl
import os
import signal
import stat
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from wil_campaign.foundation.processes.identity import ProcessId

_HEAD = """#!{python} -S
import os, signal, socket, subprocess, sys, time
open({pid_file!r}, "w").write(str(os.getpid()))
"""


class Simulators:
    """Makes programs below a folder, and looks after their processes."""

    ardupilot = """
port = 5760 + 10 * int(sys.argv[sys.argv.index("--instance") + 1])
server = socket.socket()
server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
server.bind(("127.0.0.1", port))
server.listen(5)
print("Starting SITL input")
print(f"bind port {port} for SERIAL0", file=sys.stderr)
print(f"SERIAL0 on TCP port {port}", file=sys.stderr)
open("eeprom.bin", "wb").close()
print("Waiting for connection ....", flush=True)
time.sleep(600)
"""
    px4 = """
print("INFO  [px4] instance:", sys.argv[sys.argv.index("-i") + 1])
print("\\x1b[32mINFO  [px4] Startup script returned successfully\\x1b[0m", flush=True)
time.sleep(600)
"""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.locks = folder / "locks"
        self.mourned: list[int] = []
        """Processes that a test expects to be gone; killed at its end in case they are not."""

    def program(self, body: str, *, name: str = "arducopter") -> Path:
        """Make a program, in Python, that writes its process id beside itself."""
        file = self.folder / "programs" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        tree = self.folder / "Tools" / "autotest" / "default_params"
        tree.mkdir(parents=True, exist_ok=True)
        (tree / "copter.parm").touch()
        head = _HEAD.format(python=sys.executable, pid_file=f"{file}.pid")
        file.write_text(head + body)
        file.chmod(file.stat().st_mode | stat.S_IXUSR)
        return file

    @staticmethod
    def beside(program: Path, suffix: str) -> str:
        """Read what a program wrote beside itself."""
        return Path(f"{program}.{suffix}").read_text()

    def pid_of(self, program: Path) -> int:
        return int(self.beside(program, "pid"))

    @staticmethod
    def gone(pid: int, within_s: float = 10.0) -> bool:
        """Return whether a process ends within some time."""
        end_s = time.monotonic() + within_s
        while ProcessId.of(pid) is not None:
            if time.monotonic() > end_s:
                return False
            time.sleep(0.02)
        return True

    @staticmethod
    def arguments(pid: int) -> list[str]:
        return Path(f"/proc/{pid}/cmdline").read_text().split("\0")

    @staticmethod
    def environment(pid: int) -> list[str]:
        return Path(f"/proc/{pid}/environ").read_text().split("\0")

    @staticmethod
    def works_in(pid: int) -> Path:
        return Path(f"/proc/{pid}/cwd").resolve()

    def files(self, name: str) -> list[Path]:
        return list(self.folder.rglob(name))

    def end(self) -> None:
        """Kill who should be gone."""
        for pid in self.mourned:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)


@pytest.fixture
def sims(tmp_path: Path) -> Iterator[Simulators]:
    made = Simulators(tmp_path)
    with _alone():
        yield made
        made.end()


@contextmanager
def _alone() -> Iterator[None]:
    """Wait until no other worker of pytest-xdist tests launches.

    Each test has locks of its own, and would take the instance, and the ports, of another's.
    """
    with Path(__file__).open(encoding="utf-8") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        try:
            yield
        finally:
            # What was forked meanwhile and lives on has this file open, too.
            fcntl.flock(file, fcntl.LOCK_UN)
