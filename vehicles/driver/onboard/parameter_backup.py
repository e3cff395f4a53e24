"""Parameters changed for a time: set, verified, set back in reverse; after a crash as well.

Before the first change a journal is written, whole, with what each parameter was. It stays locked
while its writer lives, so that the next start knows which journals nobody will come back for.
"""

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from vehicles.driver.onboard.crash_safe_file import CrashSafeFile, crash_safe_files
from vehicles.errors import ParameterError

ParameterValue = int | float

PARAMETERS_SUFFIX = ".parameters.json"
_SCHEMA = 1


class ParameterAccess(Protocol):
    """Reads and writes an autopilot's parameters (protocol)."""

    async def get(self, name: str) -> ParameterValue:
        """Return a parameter's value. Raises ParameterError."""

    async def set(self, name: str, value: ParameterValue) -> None:
        """Set a parameter and read it back. Raises ParameterError."""


@dataclass(frozen=True, slots=True)
class ParameterChange:
    """A changed parameter in a backup: its old value, and what it is set to."""

    name: str
    before: ParameterValue
    wanted: ParameterValue


@dataclass(frozen=True, slots=True)
class Restored:
    """The outcome of restoring a vehicle's parameter backups.

    restored: set back, or already as before. foreign: neither what we set nor what it was:
    somebody has changed it since, and it is left alone.
    """

    restored: tuple[ParameterChange, ...] = ()
    foreign: tuple[ParameterChange, ...] = ()


class ParameterBackup:
    """An async context manager that changes parameters, with a backup, and restores them.

    vehicle: whose parameters they are, as a name that stays the same. journal: the folder for the
    journal; None for none. Raises ParameterError; then all is set back as far as it can be.
    """

    def __init__(
        self,
        *,
        access: ParameterAccess,
        vehicle: str,
        changes: Mapping[str, ParameterValue],
        journal: Path | None,
    ) -> None:
        self._access = access
        self._vehicle = vehicle
        self._wanted = dict(changes)
        self._folder = journal
        self._journal: _BackupFile | None = None
        self._changes: tuple[ParameterChange, ...] = ()

    @property
    def changes(self) -> tuple[ParameterChange, ...]:
        """Return the changed parameters."""
        return self._changes

    async def __aenter__(self) -> Self:
        """Read the parameters, write the backup, set and verify them."""
        before = [(name, await self._access.get(name)) for name in self._wanted]
        self._changes = tuple(
            ParameterChange(name, value, self._wanted[name]) for name, value in before
        )
        if self._folder is not None and self._changes:
            self._journal = _BackupFile.write(self._folder, self._vehicle, self._changes)
        done: list[ParameterChange] = []
        try:
            for change in self._changes:
                done.append(change)
                await self._access.set(change.name, change.wanted)
        except BaseException as error:
            self._changes = tuple(done)
            try:
                await self._set_back()
            except ParameterError as second:
                error.add_note(str(second))
            raise
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Restore the parameters, last first. Raises ParameterError after all others."""
        try:
            await self._set_back()
        except ParameterError as second:
            if error is None:
                raise
            error.add_note(str(second))

    async def _set_back(self) -> None:
        failed: list[str] = []
        try:
            for change in reversed(self._changes):
                try:
                    await self._access.set(change.name, change.before)
                except ParameterError as error:
                    failed.append(f"{change.name} to {change.before} ({error})")
            if not failed and self._journal is not None:
                self._journal.remove()
        finally:
            if self._journal is not None:
                self._journal.close()
        if failed:
            kept = self._journal.path if self._journal is not None else None
            later = f"; {kept} has the original values for the next start" if kept else ""
            raise ParameterError(f"could not set back {'; '.join(failed)}{later}")


async def restore_backups(folder: Path, *, access: ParameterAccess, vehicle: str) -> Restored:
    """Restore a vehicle's parameters from backups of killed runs, newest first.

    Journals of runs that live, and of other vehicles, are left alone. Raises ParameterError when
    the vehicle does not take a value; the journal is kept then.
    """
    restored: list[ParameterChange] = []
    foreign: list[ParameterChange] = []
    for path in crash_safe_files(folder, PARAMETERS_SUFFIX):
        journal = _BackupFile.take(path, vehicle)
        if journal is None:
            continue
        with contextlib.closing(journal):
            for change in reversed(journal.changes):
                now = await access.get(change.name)
                ours = _same(now, change.wanted)
                if ours and not _same(now, change.before):
                    await access.set(change.name, change.before)
                (restored if ours or _same(now, change.before) else foreign).append(change)
            journal.remove()
    return Restored(tuple(restored), tuple(foreign))


def _same(one: ParameterValue, other: ParameterValue) -> bool:
    """Return whether two parameter values are equal in single precision."""
    if isinstance(one, int) and isinstance(other, int):
        return one == other
    # On the wire and in the autopilot a value has single precision.
    return math.isclose(one, other, rel_tol=1e-6, abs_tol=1e-12)


class _BackupFile:
    """A parameter backup's file, locked while open."""

    def __init__(self, note: CrashSafeFile, changes: tuple[ParameterChange, ...]) -> None:
        self.path = note.path
        self.changes = changes
        self.remove, self.close = note.remove, note.close

    @classmethod
    def write(cls, folder: Path, vehicle: str, changes: tuple[ParameterChange, ...]) -> Self:
        """Write a parameter backup, on the disk on return. Raises ParameterError."""
        document = {
            "schema": _SCHEMA,
            "vehicle": vehicle,
            "changes": [[change.name, change.before, change.wanted] for change in changes],
        }
        try:
            return cls(CrashSafeFile.write(folder, PARAMETERS_SUFFIX, document), changes)
        except OSError as error:
            raise ParameterError(
                f"the journal of parameters in {folder} cannot be written ({error.strerror}); "
                "without it they would stay changed after a crash"
            ) from error

    @classmethod
    def take(cls, path: Path, vehicle: str) -> Self | None:
        """Return a vehicle's unlocked parameter backup; None for others. Raises ParameterError."""
        note: CrashSafeFile | None = None
        try:
            note = CrashSafeFile.take(path)
            if note is None:
                return None
            if note.document["vehicle"] == vehicle:
                changes = tuple(ParameterChange(*entry) for entry in note.document["changes"])
                return cls(note, changes)
        except (ValueError, KeyError, TypeError) as error:
            if note is not None:
                note.close()
            raise ParameterError(
                f"{path} is not a parameter backup; inspect it and remove it"
            ) from error
        note.close()
        return None
