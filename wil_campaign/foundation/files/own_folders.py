"""Folders of this user: its home, and whether others may change what lies in a folder."""

import os
import stat
from pathlib import Path


def home_folder() -> Path | None:
    """Return this user's home; None without one, as for an unknown user id in a container."""
    try:
        return Path.home()
    except RuntimeError:
        return None


def fault_of_folder(folder: Path, *, denied: int = 0o077) -> str:
    """Return why a folder is not this user's alone; empty when it is. It follows no links.

    denied: the bits of the mode that others must not have; 0o022 lets them read.
    """
    try:
        about, above = folder.lstat(), folder.parent.stat()
    except OSError as error:
        return f"cannot be read: {error.strerror or error}"
    others_move_it = bool(above.st_mode & 0o022) and not above.st_mode & stat.S_ISVTX
    checks = (
        (stat.S_ISLNK(about.st_mode), "is a symbolic link"),
        (not stat.S_ISDIR(about.st_mode), "is not a folder"),
        (about.st_uid != os.getuid(), f"belongs to another user (uid {about.st_uid})"),
        (
            bool(about.st_mode & denied),
            f"is open to other users (mode {stat.S_IMODE(about.st_mode):04o})",
        ),
        (
            above.st_uid not in {0, os.getuid()} or others_move_it,
            f"can be replaced by other users, who may write to {folder.parent}",
        ),
    )
    return next((text for wrong, text in checks if wrong), "")
