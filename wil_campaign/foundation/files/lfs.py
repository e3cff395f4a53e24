"""Pointers of Git LFS, which stand in a clone for files that were not fetched."""

from pathlib import Path

_BEGINNING = b"version https://git-lfs.github.com/spec/"
"""https://github.com/git-lfs/git-lfs/blob/main/docs/spec.md"""

LFS_POINTER = "it is a pointer of Git LFS, not the file itself; run `git lfs pull`"


def is_lfs_pointer(data: bytes) -> bool:
    """Return whether a file that begins so is a pointer of Git LFS."""
    return data.startswith(_BEGINNING)


def is_lfs_file(path: Path) -> bool:
    """Return whether a file is a pointer of Git LFS. Raises OSError."""
    with path.open("rb") as file:
        return is_lfs_pointer(file.read(len(_BEGINNING)))
