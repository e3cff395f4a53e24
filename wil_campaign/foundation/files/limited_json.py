"""Reads JSON of other programs, with limits on its size, values and depth."""

import json
import os
from pathlib import Path
from typing import Any

from wil_campaign.foundation.files.limits import MAX_MESSAGE_VALUES, MAX_RESULTS_BYTES
from wil_campaign.foundation.files.paths import open_at_once


class JsonLimitError(ValueError):
    """A JSON text, or a file, that is beyond a limit; says which."""


def read_limited_bytes(path: Path, most_bytes: int = MAX_RESULTS_BYTES) -> bytes:
    """Return the bytes of a file. Raises JsonLimitError when it is too large, and OSError."""
    with open_at_once(path) as stream:
        size_bytes = os.fstat(stream.fileno()).st_size
        if size_bytes > most_bytes:
            raise JsonLimitError(f"it is larger than {most_bytes:,} bytes")
        return stream.read(size_bytes)


def check_json_values(text: bytes) -> None:
    """Raise JsonLimitError for a JSON text whose objects would fill the memory."""
    # A long text of few values has images as text, which take no more memory than the text.
    if len(text) > MAX_MESSAGE_VALUES:
        values = sum(text.count(part) for part in (b",", b"[", b"{"))
        if values > MAX_MESSAGE_VALUES:
            raise JsonLimitError(f"it has {values} values; at most {MAX_MESSAGE_VALUES} are read")


def loads_limited_json(text: bytes) -> Any:
    """Return the document of a JSON text. Raises ValueError, also where it is beyond a limit."""
    check_json_values(text)
    try:
        return json.loads(text)
    except RecursionError as error:
        raise JsonLimitError("it is nested too deep") from error


def read_limited_json(path: Path) -> Any:
    """Return the document of a JSON file. Raises ValueError, and OSError."""
    return loads_limited_json(read_limited_bytes(path))
