"""Notes of what was started, in files: who is left over from a crash is found by them.

A process is known by its id and its start time together, for ids are used again.
"""

import contextlib
import json
import os
import signal
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

RECORD = "wil-launch.json"
_END_S = 5.0
_LOOK_S = 0.05


@dataclass(frozen=True, slots=True)
class ProcessKey:
    """A process: its id, and when it started in ticks since boot (Linux); 0 where unknown."""

    pid: int
    started: int

    @property
    def alive(self) -> bool:
        """Return whether this very process lives."""
        return started_of(self.pid) == self.started


@dataclass(frozen=True, slots=True)
class LaunchRecord:
    """One start: what, where, the keeper that runs it, and for whom."""

    label: str
    folder: str
    keeper: ProcessKey
    owner: ProcessKey
    boot_id: str
    command: tuple[str, ...]
    cleanup: tuple[str, ...]

    def write(self) -> None:
        """Write it into its folder, whole or not at all."""
        file = Path(self.folder) / RECORD
        half = file.with_suffix(".tmp")
        half.write_text(json.dumps(asdict(self)), encoding="utf-8")
        half.replace(file)

    @property
    def left_over(self) -> bool:
        """Return whether it still runs, and who started it does not."""
        return self.boot_id == boot_id() and not self.owner.alive and bool(self.survivors())

    def survivors(self) -> tuple[int, ...]:
        """Return its processes that live: the keeper, or else those that work in its folder."""
        if self.boot_id != boot_id():
            return ()
        if self.keeper.alive:
            return (self.keeper.pid,)
        return tuple(_working_in(Path(self.folder)))


def own_key() -> ProcessKey:
    """Return this process."""
    return key_of(os.getpid())


def key_of(pid: int) -> ProcessKey:
    """Return a process that lives now."""
    return ProcessKey(pid, started_of(pid) or 0)


def started_of(pid: int) -> int | None:
    """Return when a process started, in ticks since boot; None when there is none by this id."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace")
    except OSError:
        return None
    fields = stat.rpartition(")")[2].split()
    # proc(5): field 3 is the state, field 22 the start time; a zombie runs no more.
    return None if fields[0] in {"Z", "X"} else int(fields[19])


def boot_id() -> str:
    """Return what tells this boot of the machine from others; empty where unknown."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
    except OSError:
        return ""


def find_leftovers(root: Path) -> tuple[LaunchRecord, ...]:
    """Return what was started in folders below `root`, still runs, and belongs to nobody."""
    return tuple(record for record in _records(root) if record.left_over)


def end_leftover(record: LaunchRecord) -> bool:
    """End a leftover: SIGTERM, then SIGKILL; return whether it is gone. Blocks for seconds."""
    give_up_s = time.monotonic() + _END_S
    number = signal.SIGTERM
    while pids := record.survivors():
        if time.monotonic() > give_up_s:
            if number == signal.SIGKILL:
                return False
            number, give_up_s = signal.SIGKILL, time.monotonic() + _END_S
        for pid in pids:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, number)
        time.sleep(_LOOK_S)
    return True


def _records(root: Path) -> Iterator[LaunchRecord]:
    for file in sorted(root.rglob(RECORD)):
        try:
            raw = json.loads(file.read_text(encoding="utf-8"))
            yield LaunchRecord(
                label=str(raw["label"]),
                folder=str(file.parent),
                keeper=ProcessKey(int(raw["keeper"]["pid"]), int(raw["keeper"]["started"])),
                owner=ProcessKey(int(raw["owner"]["pid"]), int(raw["owner"]["started"])),
                boot_id=str(raw["boot_id"]),
                command=tuple(map(str, raw["command"])),
                cleanup=tuple(map(str, raw["cleanup"])),
            )
        except (OSError, ValueError, KeyError, TypeError):
            # A record that a crash cut, or that is not ours, names no process.
            continue


def _working_in(folder: Path) -> Iterator[int]:
    inside = folder.resolve()
    for link in Path("/proc").glob("[0-9]*/cwd"):
        with contextlib.suppress(OSError):
            if link.readlink() == inside and started_of(int(link.parent.name)) is not None:
                yield int(link.parent.name)
