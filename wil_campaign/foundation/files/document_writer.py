"""Writes documents to disk atomically; the same content gives the same bytes."""

import dataclasses
import json
import os
import re
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

from wil_campaign.foundation.files.paths import is_file
from wil_campaign.foundation.files.problems import BadInput, Problem

HTML = b"<!doctype html>"
_BEGINS_BYTES = 1000


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

    A temporary file in the same folder, fsync, rename, fsync of the folder. Into what is no file it
    is written: /dev/null, renamed over, would be gone. Raises OSError.
    """
    # A lone surrogate, as in an error message, becomes '?': readers refuse its JSON escape.
    data = content.encode("utf-8", "replace") if isinstance(content, str) else content
    if path.exists() and not path.is_file():
        path.write_bytes(data)
        return
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


def require_own_file(path: Path | None, mark: bytes) -> None:
    """Raise BadInput where another kind of file is at the place where one is to be written.

    So nobody who names a campaign or a recording there loses it. mark: the pattern by which each
    file of the kind begins. path: None where nothing is to be written. A pipe is not waited for.
    """
    if path is None or not is_file(path):
        return
    try:
        with path.open("rb") as file:
            begins = file.read(_BEGINS_BYTES)
    except OSError:  # whoever writes there says why not
        return
    if begins and not re.match(mark, begins):
        message = "is another kind of file, and would be replaced: name another place, or remove it"
        raise BadInput([Problem(str(path), 0, 0, message)])


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
