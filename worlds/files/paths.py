"""Whether there is something at a path that a user wrote; never raises.

Before Python 3.14 pathlib's own raise for a name that is too long, and behind a folder that may not
be entered.
"""

from pathlib import Path


def is_file(path: Path) -> bool:
    """Return whether a file is there, as far as we may see."""
    try:
        return path.is_file()
    except OSError:
        return False


def is_folder(path: Path) -> bool:
    """Return whether a folder is there, as far as we may see."""
    try:
        return path.is_dir()
    except OSError:
        return False


def exists(path: Path) -> bool:
    """Return whether anything is there, as far as we may see."""
    try:
        return path.exists()
    except OSError:
        return False
