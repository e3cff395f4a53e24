"""Who flies on this machine: a record of each guard, and the reaping of what was left over.

A record is a JSON file in a folder of the user's own that does not outlive the boot. Processes
are named by id and start time.
"""

import contextlib
import os
import stat
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from vehicles.processes.identity import ProcessId

_FOLDER = "wil-campaign"
_LONGEST_BASE_BYTES = 107 - len("/wil-campaign/campaign-4194304.sock")


class RuntimeFolderError(OSError):
    """The runtime folder for guard records and sockets is unsafe or unavailable."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardRecord:
    """The record of one guard, to find orphans. run, folder: guarded. socket: operator's.

    owner: the orchestrator's process. children: of the vehicles. since_s: CLOCK_BOOTTIME.
    """

    run: str
    folder: str
    socket: str
    guard: ProcessId
    owner: ProcessId | None
    since_s: float
    children: tuple[ProcessId, ...] = ()

    def with_child(self, child: ProcessId) -> "GuardRecord":
        """Return the guard's record with one more child process."""
        return replace(self, children=(*self.children, child))


def runtime_folder() -> Path:
    """Return the user's folder for guard records and sockets; created when missing.

    XDG_RUNTIME_DIR where there is one that is short enough, else beneath the folder for temporary
    files: paths of Unix sockets have at most 107 bytes. Raises RuntimeFolderError when it is not
    ours alone.
    """
    base = os.environ.get("XDG_RUNTIME_DIR", "")
    fits = bool(base) and len(os.fsencode(base)) <= _LONGEST_BASE_BYTES
    folder = Path(base) / _FOLDER if fits else Path("/tmp") / f"{_FOLDER}-{os.getuid()}"  # noqa: S108 - checked below
    folder.mkdir(mode=0o700, exist_ok=True)
    about = folder.lstat()
    if not stat.S_ISDIR(about.st_mode) or about.st_uid != os.getuid() or about.st_mode & 0o077:
        raise RuntimeFolderError(
            f"{folder} belongs to another user, or others may write to it; remove it or set "
            "XDG_RUNTIME_DIR to a folder of your own"
        )
    return folder


def record_path(folder: Path, guard: ProcessId) -> Path:
    """Return the path of a guard's record."""
    return folder / f"guard-{guard.pid}-{guard.started}.json"


def write_record(folder: Path, record: GuardRecord) -> None:
    """Write a guard's record atomically, so that orphans are found. Raises OSError."""
    path = record_path(folder, record.guard)
    part = path.with_suffix(".part")
    part.write_bytes(msgspec.json.encode(record))
    part.replace(path)


def remove_record(folder: Path, guard: ProcessId) -> None:
    """Remove a guard's record, if there is one."""
    record_path(folder, guard).unlink(missing_ok=True)


def records(folder: Path) -> tuple[GuardRecord, ...]:
    """Return all guard records, the newest last; unreadable ones are skipped."""
    return tuple(sorted(_records(folder), key=lambda record: record.since_s))


def running(folder: Path) -> tuple[GuardRecord, ...]:
    """Return the records of guards that live, the newest last."""
    return tuple(record for record in records(folder) if record.guard.lives)


def _records(folder: Path) -> Iterator[GuardRecord]:
    """Yield the readable guard records of a folder."""
    for path in sorted(folder.glob("guard-*.json")):
        with contextlib.suppress(OSError, msgspec.MsgspecError, UnicodeDecodeError):
            yield msgspec.json.decode(path.read_bytes(), type=GuardRecord)


def reap_orphans(folder: Path) -> tuple[str, ...]:
    """End orphaned vehicle processes whose guard and orchestrator are gone; return a report.

    A guard that lives looks after its own; without it its orchestrator does, while it lives.
    Waits up to three seconds for each process: for the start of a program, not for a flight.
    """
    done: list[str] = []
    for record in records(folder):
        if record.guard.lives or (record.owner is not None and record.owner.lives):
            continue
        done += [
            f"process {child.pid} is left from {record.run} in {record.folder}: {how}"
            for child in record.children
            if child.lives and (how := child.end())
        ]
        remove_record(folder, record.guard)
        Path(record.socket).unlink(missing_ok=True)
    return tuple(done)
