"""Who flies on this machine: a record of each guard, and the reaping of what was left over.

A record is a JSON file in a folder of the user's own that does not outlive the boot. Processes
are named by id and start time.
"""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from wil_campaign.foundation.processes.identity import ProcessId
from wil_campaign.safety.guard.process.runtime_folder import is_socket_served


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardRecord:
    """The record of one guard, to find orphans. run, folder: guarded. socket: operator's.

    campaign: the folder of the run's campaign, on the machine that flies it; empty for none. owner:
    the orchestrator's process. children: of the vehicles. since_s: CLOCK_BOOTTIME.
    """

    run: str
    folder: str
    socket: str
    guard: ProcessId
    owner: ProcessId | None
    since_s: float
    children: tuple[ProcessId, ...] = ()
    campaign: str = ""

    def with_child(self, child: ProcessId) -> "GuardRecord":
        """Return the guard's record with one more child process."""
        return replace(self, children=(*self.children, child))


def guard_record_path(folder: Path, guard: ProcessId) -> Path:
    """Return the path of a guard's record."""
    return folder / f"guard-{guard.pid}-{guard.started}.json"


def write_guard_record(folder: Path, record: GuardRecord) -> None:
    """Write a guard's record atomically, so that orphans are found. Raises OSError."""
    path = guard_record_path(folder, record.guard)
    part = path.with_suffix(".part")
    part.write_bytes(msgspec.json.encode(record))
    part.replace(path)


def remove_guard_record(folder: Path, guard: ProcessId) -> None:
    """Remove a guard's record, if there is one."""
    guard_record_path(folder, guard).unlink(missing_ok=True)


def guard_records(folder: Path) -> tuple[GuardRecord, ...]:
    """Return all guard records, the newest last; unreadable ones are skipped."""
    return tuple(sorted(_records(folder), key=lambda record: record.since_s))


def running_guards(folder: Path) -> tuple[GuardRecord, ...]:
    """Return the records of guards that live, the newest last; also those of a container."""
    return tuple(record for record in guard_records(folder) if _is_running(record))


def _is_running(record: GuardRecord) -> bool:
    return record.guard.lives or is_socket_served(Path(record.socket))


def _records(folder: Path) -> Iterator[GuardRecord]:
    for path in sorted(folder.glob("guard-*.json")):
        with contextlib.suppress(OSError, msgspec.MsgspecError, UnicodeDecodeError):
            yield msgspec.json.decode(path.read_bytes(), type=GuardRecord)


def reap_orphans(folder: Path) -> tuple[str, ...]:
    """End orphaned vehicle processes whose guard and orchestrator are gone; return a report.

    A guard that lives looks after its own; without it its orchestrator does, while it lives.
    Waits up to three seconds for each process: for the start of a program, not for a flight.
    """
    done: list[str] = []
    for record in guard_records(folder):
        if _is_running(record) or (record.owner is not None and record.owner.lives):
            continue
        done += [
            f"process {child.pid} is left from {record.run} in {record.folder}: {how}"
            for child in record.children
            if child.lives and (how := child.end())
        ]
        remove_guard_record(folder, record.guard)
        Path(record.socket).unlink(missing_ok=True)
    return tuple(done)
