"""guard.stderr: what a guard's process printed before it died."""

import contextlib
from pathlib import Path
from typing import IO

_NAME = "guard.stderr"
_LONGEST = 2000


def open_stderr(folder: str) -> IO[bytes]:
    """Return the file for the guard's stderr in its run's folder. Raises OSError."""
    return (Path(folder) / _NAME).open("w+b")


def guard_stderr_tail(folder: str) -> str:
    """Return that the guard ended, with the last lines of its stderr."""
    words = ""
    with contextlib.suppress(OSError):
        words = (Path(folder) / _NAME).read_text(encoding="utf-8")
    return f"the guard's process ended: {words[-_LONGEST:].strip() or 'it printed nothing'}"


def remove_if_empty(folder: str) -> None:
    """Remove the guard's stderr file if it is empty."""
    path = Path(folder) / _NAME
    with contextlib.suppress(OSError):
        if path.stat().st_size == 0:
            path.unlink()
