"""The files that a campaign's documents name, and the files that those name in turn."""

import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from vehicles.sources.cameras.image_files import IMAGE_SUFFIXES
from worlds.files.documents import Data
from worlds.files.paths import is_file, is_folder

_MESH_SUFFIXES = frozenset({".obj", ".mtl", ".dae", ".gltf"})
_COMPANION = re.compile(r"[^\"'<>\t\r\n]+\.(?:mtl|png|jpg|jpeg|bmp|tga|bin)\b", re.IGNORECASE)
_PX4_PROGRAM = Path("bin") / "px4"
"""The program in a folder in which PX4 was built."""
_SIGNING = "signing"
"""The key of a vehicle's link that names a passphrase file: a digest would allow guessing it."""


def named_files(value: Data, beside: Path) -> Iterator[Path]:
    """Yield the files that texts in a value name, `file.py:Name` included, with their companions.

    For a folder these are its images, which are a camera's source, and the program of a PX4 build.
    A text that names no existing file yields nothing, nor does a signing key. beside: the
    document's path.
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
                yield from _files_of_folder(path)


def with_companions(paths: Iterable[Path]) -> list[Path]:
    """Return files and the files that meshes among them name, sorted. Raises OSError."""
    complete: set[Path] = set()
    waiting = list(paths)
    while waiting:
        path = waiting.pop()
        if path not in complete:
            complete.add(path)
            waiting.extend(_companions_of(path))
    return sorted(complete)


def _files_of_folder(folder: Path) -> Iterator[Path]:
    """Yield the files that a run reads in a folder that a document names."""
    yield from sorted(one for one in folder.iterdir() if one.suffix.lower() in IMAGE_SUFFIXES)
    if is_file(folder / _PX4_PROGRAM):
        yield folder / _PX4_PROGRAM


def _companions_of(path: Path) -> list[Path]:
    """Return the existing buffers, materials and textures that a mesh file names."""
    if path.suffix.lower() not in _MESH_SUFFIXES:
        return []
    companions: list[Path] = []
    for name in _COMPANION.findall(path.read_text("utf-8", "replace")):
        words = name.split(" ")
        # A keyword and options come before a name, which may contain blanks.
        candidates = (path.parent / " ".join(words[k:]) for k in range(len(words)))
        companions.extend(one.resolve() for one in candidates if one.name and is_file(one))
    return companions
