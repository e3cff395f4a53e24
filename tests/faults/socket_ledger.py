"""Which sockets a flight's processes opened, which of them outlive the flight, and which files.

A socket is known by its inode, so that those of other programs on the machine do not count. One
outlives a flight only where a process holds it that nobody knows for the flight's: what was started
with an environment of its own, or was handed the socket.
"""

import asyncio
import contextlib
import os
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

from tests.faults.inspection import processes_of
from wil_campaign.orchestrator.operator.campaign_records import operator_places
from wil_campaign.safety.guard.process.orphaned_processes import reap_orphans
from wil_campaign.safety.guard.process.runtime_folder import sweep_runtime_folder

_LOOK_S = 0.2
_TABLES = ("unix", "udp", "udp6", "tcp", "tcp6", "raw", "packet", "netlink")
_INODE_COLUMN = {"unix": 6, "packet": 8}
_PATH_COLUMN = 7
_CACHES = ("wil-jsbsim-",)
"""Folders beneath TMPDIR that are there for the next flight too."""


class SocketLedger:
    """The sockets that processes of a flight have held; runtime: the flight's XDG_RUNTIME_DIR."""

    def __init__(self, runtime: Path) -> None:
        self._runtime = runtime
        self.seen: dict[int, str] = {}

    def look(self) -> None:
        """Note all sockets that processes of the flight hold now."""
        own = set(_held_by(os.getpid()))
        for pid, (_, words) in processes_of(self._runtime).items():
            for inode in _held_by(pid):
                if inode not in own:
                    self.seen.setdefault(inode, f"{pid} {words[:60]}")

    def left(self) -> list[str]:
        """Return which of them exist still, with all that is bound beneath the runtime folder."""
        found = []
        for table in _TABLES:
            for inode, words in _entries(table):
                if inode and (inode in self.seen or str(self._runtime) in words):
                    found.append(f"{words} of {self.seen.get(inode, 'an unknown process')}")
        return found


@asynccontextmanager
async def socket_ledger(runtime: Path) -> AsyncIterator[SocketLedger]:
    """Look at the sockets of a flight's processes five times a second."""
    ledger = SocketLedger(runtime)

    async def watch() -> None:
        while True:
            ledger.look()
            await asyncio.sleep(_LOOK_S)

    watching = asyncio.create_task(watch())
    try:
        yield ledger
    finally:
        watching.cancel()
        await asyncio.gather(watching, return_exceptions=True)


def files_left(runtime: Path) -> list[str]:
    """Return what a flight left in its runtime folder and beneath its TMPDIR, caches apart."""
    found = []
    for path in sorted(runtime.rglob("*")):
        place = path.relative_to(runtime)
        is_ours = place.parts[0] == "wil-campaign" and path.is_dir() and not path.is_symlink()
        if is_ours or place.parts == ("tmp",) or any(map(_is_cache, place.parts[1:2])):
            continue
        found.append(str(place))
    return found


def start_again(runtime: Path) -> None:
    """Do what a next start does with what a killed flight could not remove."""
    folder = runtime / "wil-campaign"
    if not folder.is_dir():
        return
    before = os.environ.get("XDG_RUNTIME_DIR")
    os.environ["XDG_RUNTIME_DIR"] = str(runtime)
    try:
        operator_places()
        reap_orphans(folder)
        sweep_runtime_folder(folder)
    finally:
        if before is None:
            del os.environ["XDG_RUNTIME_DIR"]
        else:
            os.environ["XDG_RUNTIME_DIR"] = before


def _is_cache(name: str) -> bool:
    return name.startswith(_CACHES)


def _held_by(pid: int) -> Iterator[int]:
    with contextlib.suppress(OSError):
        for end in Path(f"/proc/{pid}/fd").iterdir():
            with contextlib.suppress(OSError):
                words = str(end.readlink())
                if words.startswith("socket:["):
                    yield int(words[len("socket:[") : -1])


def _entries(table: str) -> Iterator[tuple[int, str]]:
    """Yield inode and description of each socket in a table of the kernel's."""
    try:
        lines = Path(f"/proc/net/{table}").read_text("utf-8", "replace").splitlines()[1:]
    except OSError:
        return
    for line in lines:
        columns = line.split()
        inode = int(columns[_INODE_COLUMN.get(table, 9)])
        where = " ".join(columns[_PATH_COLUMN:]) if table == "unix" else ""
        if table.startswith(("udp", "tcp")):
            where = f"port {int(columns[1].rpartition(':')[2], 16)}"
        yield inode, f"{table} {where}".strip()
