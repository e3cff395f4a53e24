"""Writes documents to disk atomically; the same content gives the same bytes."""

import dataclasses
import json
import os
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any


def to_json(document: object, *, indent: int | None = 2) -> str:
    """Return a document (dataclass or plain values) as JSON, keys in the order of its fields.

    Floats are written so that they read back the same. Raises ValueError for NaN and infinity.
    """
    plain = (
        plain_document(document)
        if dataclasses.is_dataclass(document) and not isinstance(document, type)
        else document
    )
    return json.dumps(plain, indent=indent, allow_nan=False, ensure_ascii=False) + "\n"


def plain_document(document: Any) -> dict[str, Any]:
    """Return a dataclass as plain values, without `topics` where it has none."""
    return dataclasses.asdict(document, dict_factory=_present)


def _present(fields: list[tuple[str, Any]]) -> dict[str, Any]:
    return {name: value for name, value in fields if value or name != "topics"}


def write_atomically(path: Path, content: str | bytes) -> None:
    """Write a document atomically: a reader sees all of it or the old one, also after a crash.

    A temporary file in the same folder, fsync, rename, fsync of the folder. Raises OSError.
    """
    # A lone surrogate, as in an error message, becomes '?': readers refuse its JSON escape.
    data = content.encode("utf-8", "replace") if isinstance(content, str) else content
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fchmod(stream.fileno(), 0o644)
            os.fsync(stream.fileno())
        Path(name).replace(path)
    except BaseException:
        with suppress(FileNotFoundError):
            Path(name).unlink()
        raise
    sync_folder(path.parent)


def sync_files(folder: Path) -> None:
    """Sync every file of a folder, and its directory entries, to the disk. Raises OSError."""
    for path in sorted(folder.iterdir()):
        if path.is_file():
            handle = os.open(path, os.O_RDONLY)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)
    sync_folder(folder)


def sync_folder(folder: Path) -> None:
    """Sync the directory entries of a folder to the disk. Raises OSError."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
