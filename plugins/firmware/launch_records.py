"""Records of launches in files, by which processes orphaned by a crash are found."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from wil_campaign.foundation.processes.identity import ProcessId, boot_id, working_in

RECORD = "wil-launch.json"


@dataclass(frozen=True, slots=True)
class LaunchRecord:
    """The record of one launch: what, where, its supervisor, and for which process."""

    label: str
    folder: str
    supervisor: ProcessId
    owner: ProcessId
    boot_id: str
    command: tuple[str, ...]
    cleanup: tuple[str, ...]

    def write(self) -> None:
        """Write the launch record into its folder, atomically."""
        file = Path(self.folder) / RECORD
        half = file.with_suffix(".tmp")
        half.write_bytes(msgspec.json.encode(self))
        half.replace(file)

    @property
    def is_orphan(self) -> bool:
        """Return whether the launched program is an orphan: it runs, its owner does not."""
        return self.boot_id == boot_id() and not self.owner.lives and bool(self.survivors())

    def survivors(self) -> tuple[ProcessId, ...]:
        """Return the launch's living processes: supervisor, or what works in its folder."""
        if self.boot_id != boot_id():
            return ()
        if self.supervisor.lives:
            return (self.supervisor,)
        return tuple(working_in(Path(self.folder)))


def find_orphaned_launches(root: Path) -> tuple[LaunchRecord, ...]:
    """Return the launch records of orphans in folders below `root`."""
    return tuple(record for record in _records(root) if record.is_orphan)


def _records(root: Path) -> Iterator[LaunchRecord]:
    for file in sorted(root.rglob(RECORD)):
        # A record that is truncated, or not of this program, names no process.
        with contextlib.suppress(OSError, msgspec.MsgspecError, UnicodeDecodeError):
            record = msgspec.json.decode(file.read_bytes(), type=LaunchRecord)
            yield replace(record, folder=str(file.parent))
