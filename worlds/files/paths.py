"""File checks for paths that a user wrote; they never raise.

Before Python 3.14 pathlib's methods raise for a name that is too long, and in a folder that may not
be entered.
"""

from pathlib import Path


def is_file(path: Path) -> bool:
    """Return whether the path is a file; False where access is denied."""
    try:
        return path.is_file()
    except OSError:
        return False


def is_folder(path: Path) -> bool:
    """Return whether the path is a folder; False where access is denied."""
    try:
        return path.is_dir()
    except OSError:
        return False


def exists(path: Path) -> bool:
    """Return whether the path exists; False where access is denied."""
    try:
        return path.exists()
    except OSError:
        return False
