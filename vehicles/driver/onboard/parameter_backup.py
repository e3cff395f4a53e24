"""Changes parameters for a run and restores them in reverse order, after a crash as well.

Before the first change a backup file with the original values is written. It stays locked while its
writer lives, so that the next start restores only backups of processes that are gone.
"""

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from wil_campaign.foundation.tasks import finish_in_task
from wil_campaign.vehicles.driver.onboard.crash_safe_file import CrashSafeFile, crash_safe_files
from wil_campaign.vehicles.driver.onboard.disk_access import access_disk, remove_backup
from wil_campaign.vehicles.errors import ParameterError

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
class RestoredParameters:
    """The outcome of restoring a vehicle's parameter backups.

    restored: set back, or already at its original value. foreign: has neither our value nor the
    original one: it has been changed since, and is left alone.
    """

    restored: tuple[ParameterChange, ...] = ()
    foreign: tuple[ParameterChange, ...] = ()


class ParameterBackup:
    """An async context manager that changes parameters, with a backup, and restores them.

    vehicle: a name of the vehicle that stays the same. folder: for the backup file; None for no
    file. Raises ParameterError; then all parameters are restored as far as possible.
    """

    def __init__(
        self,
        *,
        access: ParameterAccess,
        vehicle: str,
        changes: Mapping[str, ParameterValue],
        folder: Path | None,
    ) -> None:
        self._access = access
        self._vehicle = vehicle
        self._wanted = dict(changes)
        self._folder = folder
        self._backup: _BackupFile | None = None
        self._changes: tuple[ParameterChange, ...] = ()

    @property
    def changes(self) -> tuple[ParameterChange, ...]:
        """Return the changed parameters; empty once they are restored."""
        return self._changes

    async def __aenter__(self) -> Self:
        """Read the parameters, write the backup, set and verify them."""
        before = [(name, await self._access.get(name)) for name in self._wanted]
        self._changes = tuple(
            ParameterChange(name, value, self._wanted[name]) for name, value in before
        )
        done: list[ParameterChange] = []
        try:
            if self._folder is not None and self._changes:
                await finish_in_task(self._back_up(self._folder), name="parameter backup")
            for change in self._changes:
                done.append(change)
                await self._access.set(change.name, change.wanted)
        except BaseException as error:
            self._changes = tuple(done)
            try:
                await self._restore()
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
        """Restore the parameters, last first. Raises ParameterError, once all were tried."""
        try:
            await self._restore()
        except ParameterError as second:
            if error is None:
                raise
            error.add_note(str(second))

    def leave(self) -> bool:
        """Leave the parameters changed, for `restore_backups`; return whether there are any."""
        left = bool(self._changes)
        if self._backup is not None:
            self._backup.close()
        self._backup, self._changes = None, ()
        return left

    async def _back_up(self, folder: Path) -> None:
        """Write the backup, in a thread, as the disk may stand still; to be finished."""
        write = partial(_BackupFile.write, folder, self._vehicle, self._changes)
        try:
            self._backup = await access_disk(
                write, name="parameter backup", late=lambda backup: backup.discard()
            )
        except OSError as error:
            raise ParameterError(
                f"the parameter backup in {folder} cannot be written ({error.strerror}); "
                "without it the parameters would stay changed after a crash. Make room there, or "
                "give the right to write there"
            ) from error

    async def _restore(self) -> None:
        failed: list[str] = []
        left = ""
        try:
            for change in reversed(self._changes):
                try:
                    await self._access.set(change.name, change.before)
                except ParameterError as error:
                    failed.append(f"{change.name} to {change.before} ({error})")
            if not failed:
                self._changes = ()
                if (backup := self._backup) is not None:
                    left = await remove_backup(backup.path, backup.remove, name="parameter backup")
        finally:
            if self._backup is not None:
                self._backup.close()
        if failed:
            path = self._backup.path if self._backup is not None else None
            later = f"; the next start tries again, from {path}" if path else ""
            raise ParameterError(f"could not restore {'; '.join(failed)}{later}")
        if left:
            raise ParameterError(f"the parameters are restored, but their {left}")


async def restore_backups(
    folder: Path, *, access: ParameterAccess, vehicle: str
) -> RestoredParameters:
    """Restore a vehicle's parameters from backups of killed runs, newest first.

    Backups of running runs, and of other vehicles, are left alone. Raises ParameterError when the
    vehicle does not accept a value; the backup is kept then.
    """
    restored: list[ParameterChange] = []
    foreign: list[ParameterChange] = []
    for path in crash_safe_files(folder, PARAMETERS_SUFFIX):
        backup = _BackupFile.take(path, vehicle)
        if backup is None:
            continue
        with contextlib.closing(backup):
            failed: list[str] = []
            for change in reversed(backup.changes):
                try:
                    now = await access.get(change.name)
                    ours = _same(now, change.wanted)
                    if ours and not _same(now, change.before):
                        await access.set(change.name, change.before)
                except ParameterError as error:
                    failed.append(f"{change.name} to {change.before} ({error})")
                    continue
                (restored if ours or _same(now, change.before) else foreign).append(change)
            if failed:
                # Its firmware may have another name for it by now.
                raise ParameterError(
                    f"could not restore what an earlier run changed: {'; '.join(failed)}; try "
                    f"again, or set it yourself and remove {path}"
                )
            backup.remove()
    return RestoredParameters(tuple(restored), tuple(foreign))


def _same(one: ParameterValue, other: ParameterValue) -> bool:
    """Return whether two parameter values are equal in single precision."""
    if isinstance(one, int) and isinstance(other, int):
        return one == other
    # In MAVLink and in the autopilot a value has single precision.
    return math.isclose(one, other, rel_tol=1e-6, abs_tol=1e-12)


class _BackupFile:
    """A parameter backup's file, locked while open."""

    def __init__(self, file: CrashSafeFile, changes: tuple[ParameterChange, ...]) -> None:
        self.path = file.path
        self.changes = changes
        self.remove, self.close, self.discard = file.remove, file.close, file.discard

    @classmethod
    def write(cls, folder: Path, vehicle: str, changes: tuple[ParameterChange, ...]) -> Self:
        """Write a parameter backup, synced to the disk. Raises OSError."""
        document = {
            "schema": _SCHEMA,
            "vehicle": vehicle,
            "changes": [[change.name, change.before, change.wanted] for change in changes],
        }
        return cls(CrashSafeFile.write(folder, PARAMETERS_SUFFIX, document), changes)

    @classmethod
    def take(cls, path: Path, vehicle: str) -> Self | None:
        """Return a vehicle's unlocked parameter backup; None for others. Raises ParameterError."""
        file: CrashSafeFile | None = None
        try:
            file = CrashSafeFile.take(path)
            if file is None:
                return None
            if file.document["vehicle"] == vehicle:
                changes = tuple(ParameterChange(*entry) for entry in file.document["changes"])
                return cls(file, changes)
        except (ValueError, KeyError, TypeError) as error:
            if file is not None:
                file.close()
            raise ParameterError(
                f"{path} is not a parameter backup; inspect it and remove it"
            ) from error
        file.close()
        return None
