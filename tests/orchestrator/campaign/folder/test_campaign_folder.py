"""A campaign's folder: what is locked while it is flown."""

import fcntl
import os
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from wil_campaign.orchestrator.campaign.folder.campaign_folder import (
    FolderTakenError,
    locked_campaign_folder,
    locked_run_folder,
)

Held = Callable[[Path], AbstractContextManager[None]]


@pytest.mark.parametrize("lock", [locked_campaign_folder, locked_run_folder])
def test_the_locked_file_is_open_for_writing(
    lock: Held, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Linux passes no other lock on to a server of NFS."""
    folder = tmp_path / "default" / "sim" / "1"
    folder.mkdir(parents=True)
    locked: list[tuple[bool, int]] = []
    flock = fcntl.flock

    def record(handle: int, how: int) -> None:
        mode = fcntl.fcntl(handle, fcntl.F_GETFL) & os.O_ACCMODE
        locked.append((Path(f"/proc/self/fd/{handle}").is_file(), mode))
        flock(handle, how)

    monkeypatch.setattr(fcntl, "flock", record)
    with lock(folder), pytest.raises(FolderTakenError, match="is in use by another"), lock(folder):
        pass
    assert locked == [(True, os.O_RDWR)] * 2
    with lock(folder):
        pass


def test_the_lock_of_a_run_is_beside_its_files_and_stays_with_its_place(tmp_path: Path) -> None:
    folder = tmp_path / "1"
    folder.mkdir()
    with locked_run_folder(folder):
        assert not any(folder.iterdir())
        folder.rename(tmp_path / "2")
        folder.mkdir()
        with pytest.raises(FolderTakenError), locked_run_folder(folder):
            pass
