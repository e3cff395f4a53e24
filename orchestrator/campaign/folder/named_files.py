"""The files that a campaign's documents name, and those that a named file names in its turn."""

import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from vehicles.sources.cameras.image_files import IMAGE_SUFFIXES
from worlds.files.documents import Data
from worlds.files.paths import is_file, is_folder

_NAMING = frozenset({".obj", ".mtl", ".dae", ".gltf"})
_NAMED = re.compile(r"[^\"'<>\t\r\n]+\.(?:mtl|png|jpg|jpeg|bmp|tga|bin)\b", re.IGNORECASE)
_PROGRAM_OF_A_BUILD = Path("bin") / "px4"
"""What is started of a folder in which PX4 was built."""
_SIGNING = "signing"
"""The key of a vehicle's link: a digest of a passphrase is a place to try guesses at."""


def named_files(value: Data, beside: Path) -> Iterator[Path]:
    """Yield the files that texts in a value name, `file.py:Name` included, with their companions.

    Of a folder the images in it, which are a camera's source, and the program of a PX4 build. A
    text without a file of its name yields nothing, and the keys that sign links none at all.
    beside: the document's path.
    """
    if isinstance(value, dict):
        for key, inner in value.items():
            if key != _SIGNING:
                yield from named_files(inner, beside)
    elif isinstance(value, list):
        for inner in value:
            yield from named_files(inner, beside)
    elif isinstance(value, str) and value:
        name = value.rpartition(":")[0] if ".py:" in value else value
        with suppress(OSError, ValueError, RuntimeError):  # a text that is no path at all
            path = (beside.parent / Path(name).expanduser()).resolve()
            if is_file(path):
                yield from with_companions([path])
            elif is_folder(path) and not beside.resolve().is_relative_to(path):
                yield from _of_folder(path)


def with_companions(paths: Iterable[Path]) -> list[Path]:
    """Return files and what they need beside them, sorted: what meshes name. Raises OSError."""
    found: set[Path] = set()
    waiting = list(paths)
    while waiting:
        path = waiting.pop()
        if path not in found:
            found.add(path)
            waiting.extend(_companions_of(path))
    return sorted(found)


def _of_folder(folder: Path) -> Iterator[Path]:
    """Yield what a run reads of a folder that a document names."""
    yield from sorted(one for one in folder.iterdir() if one.suffix.lower() in IMAGE_SUFFIXES)
    if is_file(folder / _PROGRAM_OF_A_BUILD):
        yield folder / _PROGRAM_OF_A_BUILD


def _companions_of(path: Path) -> list[Path]:
    """Return the buffers, materials and pictures that a mesh's file names, where they are."""
    if path.suffix.lower() not in _NAMING:
        return []
    found: list[Path] = []
    for name in _NAMED.findall(path.read_text("utf-8", "replace")):
        words = name.split(" ")
        # A keyword and options stand before a name, which may have blanks of its own.
        tried = (path.parent / " ".join(words[k:]) for k in range(len(words)))
        found.extend(one.resolve() for one in tried if one.name and is_file(one))
    return found
