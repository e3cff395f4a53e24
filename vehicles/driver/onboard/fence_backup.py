"""Backs up the fence of an autopilot before ours replaces it, to restore it after a crash."""

import contextlib
from collections.abc import Sequence
from dataclasses import astuple, fields, replace
from pathlib import Path
from typing import Any

from wil_campaign.vehicles.driver.onboard.crash_safe_file import CrashSafeFile, crash_safe_files
from wil_campaign.vehicles.driver.onboard.fence_protocol import FenceProtocol
from wil_campaign.vehicles.driver.onboard.mission_protocol import MissionError, MissionItem
from wil_campaign.vehicles.driver.onboard.parameter_backup import PARAMETERS_SUFFIX

FENCE_SUFFIX = ".fence.json"
_SCHEMA = 1


def back_up_fence(
    folder: Path, vehicle: str, *, own: Sequence[MissionItem], ours: Sequence[MissionItem]
) -> CrashSafeFile:
    """Back up a vehicle's fence before `ours` replaces it. Raises MissionError."""
    document = {
        "schema": _SCHEMA,
        "vehicle": vehicle,
        "own": [astuple(item) for item in own],
        "ours": [astuple(item) for item in ours],
    }
    try:
        return CrashSafeFile.write(folder, FENCE_SUFFIX, document)
    except OSError as error:
        raise fence_backup_error(folder, error) from error


def fence_backup_error(folder: Path, error: OSError) -> MissionError:
    """Return the error that a fence backup could not be written."""
    return MissionError(
        f"the fence backup in {folder} cannot be written ({error.strerror}); without it the "
        "vehicle would keep the campaign's fence after a crash. Make room there, or give the right "
        "to write there"
    )


async def restore_fence(folder: Path, *, fences: FenceProtocol, vehicle: str) -> bool:
    """Restore a vehicle's fence from backups of runs that were killed.

    Returns whether it restored one. A fence that is not ours is left alone, and so are backups of
    running runs and of other vehicles. Raises MissionError; the backup is kept then.
    """
    restored = False
    for path in crash_safe_files(folder, FENCE_SUFFIX):
        try:
            backup = CrashSafeFile.take(path)
            if backup is None:
                continue
            with contextlib.closing(backup):
                if backup.document["vehicle"] != vehicle:
                    continue
                own, ours = _items(backup.document["own"]), _items(backup.document["ours"])
                try:
                    if _is_same_fence(ours, await fences.items()):
                        await fences.restore(own)
                        restored = True
                except MissionError as error:
                    raise MissionError(
                        f"could not restore the fence that an earlier run replaced ({error}); try "
                        f"again, or set it yourself and remove {path}"
                    ) from error
                backup.remove()
        except (ValueError, KeyError, TypeError) as error:
            raise MissionError(f"{path} is not a fence backup; inspect it and remove it") from error
    return restored


def waiting_backups(folder: Path) -> tuple[Path, ...]:
    """Return the backup files in a folder that wait to be restored, of every kind."""
    return (*crash_safe_files(folder, PARAMETERS_SUFFIX), *crash_safe_files(folder, FENCE_SUFFIX))


def _items(rows: Sequence[Sequence[Any]]) -> tuple[MissionItem, ...]:
    names = [field.name for field in fields(MissionItem)]
    items = [MissionItem(**dict(zip(names, row, strict=True))) for row in rows]
    params = [(*map(float, item.params),) for item in items]
    return tuple(
        replace(item, params=(a, b, c, d)) for item, (a, b, c, d) in zip(items, params, strict=True)
    )


def _is_same_fence(sent: Sequence[MissionItem], now: Sequence[MissionItem]) -> bool:
    return len(sent) == len(now) and all(
        mission_item.agrees(other) for mission_item, other in zip(sent, now, strict=True)
    )
