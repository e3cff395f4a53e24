"""File checks for paths that a user wrote; they never raise, except `require_utf8`.

Before Python 3.14 pathlib's methods raise for a name that is too long, and in a folder that may not
be entered.
"""

import os
from contextlib import suppress
from io import BufferedReader
from pathlib import Path

from wil_campaign.foundation.files.problems import BadInput, Problem, is_encodable


def require_utf8(path: Path) -> None:
    """Raise BadInput for a path with a part that is not UTF-8, as it is from the root.

    Recordings, messages between processes and JSON have texts in UTF-8, and paths among them.
    Raises OSError where the current folder is gone.
    """
    part = next((one for one in path.absolute().parts if not is_encodable(one)), "")
    if part:
        name = part.encode("utf-8", "backslashreplace").decode()
        message = f"the name '{name}' in its path is not UTF-8: rename it"
        raise BadInput([Problem(str(path), 0, 0, message)])


def expanded_path(path: Path) -> Path:
    """Return a path with its ~ expanded; as it is where there is no such user, or no home."""
    try:
        return path.expanduser()
    except RuntimeError:
        return path


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


def path_exists(path: Path) -> bool:
    """Return whether the path exists; False where access is denied."""
    try:
        return path.exists()
    except OSError:
        return False


def open_at_once(path: Path) -> BufferedReader:
    """Open a file to read; a named pipe is not waited for, and is an empty file. Raises OSError."""
    return open(path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK))


def file_sizes(folder: Path) -> dict[Path, int]:
    """Return the files beneath a folder with their sizes in bytes; what vanishes is left out.

    Path.rglob raises when another process removes a folder meanwhile.
    """
    sizes = {}
    for home, _, names in os.walk(folder):
        for path in map(Path(home).joinpath, names):
            with suppress(OSError):
                sizes[path] = path.lstat().st_size
    return sizes
