"""JSON files with what to restore after a crash, each locked while its writer lives.

A free lock tells the next start that the writer is gone and that the file is to be restored.
"""

import fcntl
import json
import os
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self


class CrashSafeFile:
    """A numbered JSON file that survives a crash, locked while open; document: content."""

    def __init__(self, path: Path, handle: int, document: Any) -> None:
        self.path = path
        self.document = document
        self._handle: int | None = handle
        self._is_removed = False

    @classmethod
    def write(cls, folder: Path, suffix: str, document: Mapping[str, object]) -> Self:
        """Write a crash-safe file and sync it to the disk. Raises OSError.

        A memory card takes seconds for it: a flight calls it in a thread. Several threads may.
        """
        folder.mkdir(parents=True, exist_ok=True)
        number = (
            max((_number(path, suffix) for path in crash_safe_files(folder, suffix)), default=0) + 1
        )
        writer = f"{os.getpid()}-{threading.get_ident()}"
        half = folder / f"{number:06d}{suffix}.{writer}.tmp"
        handle = os.open(half, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        try:
            # The lock belongs to the file, whatever its name.
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            with open(handle, "wb", closefd=False) as file:
                file.write(json.dumps(document).encode())
            os.fsync(handle)
            path = _link_numbered(half, folder, number, suffix)
        except BaseException:
            os.close(handle)
            raise
        finally:
            half.unlink(missing_ok=True)
        _sync_folder(folder)
        return cls(path, handle, document)

    @classmethod
    def take(cls, path: Path) -> Self | None:
        """Return an unlocked crash-safe file; None when it is locked or gone.

        Raises ValueError when it is not JSON.
        """
        try:
            handle = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        except FileNotFoundError:
            return None
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return cls(path, handle, json.loads(path.read_text(encoding="utf-8")))
        except (BlockingIOError, FileNotFoundError):
            os.close(handle)
            return None
        except BaseException:
            os.close(handle)
            raise

    def remove(self) -> None:
        """Remove the crash-safe file, once: later another file may have its number."""
        if not self._is_removed:
            self.path.unlink(missing_ok=True)
            self._is_removed = True

    def discard(self) -> None:
        """Remove and close the crash-safe file: nobody needs it any more."""
        try:
            self.remove()
        finally:
            self.close()

    def close(self) -> None:
        """Release the crash-safe file's lock."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None


def crash_safe_files(folder: Path, suffix: str) -> list[Path]:
    """Return the crash-safe files of one kind in a folder, newest first."""
    files = folder.glob(f"*{suffix}")
    return sorted(files, key=lambda path: _number(path, suffix), reverse=True)


def _number(path: Path, suffix: str) -> int:
    """Return the number of a crash-safe file by its name; 0 without."""
    text = path.name.removesuffix(suffix)
    return int(text) if text.isdecimal() else 0


def _link_numbered(half: Path, folder: Path, number: int, suffix: str) -> Path:
    """Give a crash-safe file the first free number, without replacing another run's file."""
    while True:
        path = folder / f"{number:06d}{suffix}"
        try:
            os.link(half, path)
        except FileExistsError:
            number += 1
        else:
            return path


def _sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
