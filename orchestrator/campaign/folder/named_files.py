"""The files that a campaign's documents name, and the files that those name in turn."""

import os
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from wil_campaign.foundation.files.documents import Data
from wil_campaign.foundation.files.paths import is_file, is_folder, path_exists
from wil_campaign.vehicles.sources.camera_source import IMAGE_SUFFIXES
from wil_campaign.worlds.scene.mesh_formats import files_named_by_mesh

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
    for name in _names(value):
        yield from _files_of(name, beside)


def files_in_place(value: Data, beside: Path) -> Iterator[tuple[Path, Path]]:
    """Yield the files that a value names absolutely, or from the home by `~`, as named and as here.

    Wherever the value is read, it means the file of that machine. beside: the document's path.
    """
    for name in _names(value):
        if name.startswith(("/", "~")):
            for path in _files_of(name, beside):
                inner = os.path.relpath(path, _expanded(Path(name), beside))
                yield Path(os.path.normpath(Path(name) / inner)), path


def path_as_used(path: Path) -> Path:
    """Return a path absolute and without `..`, with the symlinks by which its file is used."""
    plain = Path(os.path.abspath(path))  # noqa: PTH100 - Path.absolute() keeps `..`
    return plain if path_exists(plain) and plain.samefile(path) else path.resolve()


def document_place(path: Path) -> Path:
    """Return a document's absolute path: names in it are relative to its folder's real place."""
    return path.parent.resolve() / path.name


def _names(value: Data) -> Iterator[str]:
    """Yield the texts in a value that may name files, `file.py:Name` as the file alone."""
    if isinstance(value, dict):
        for key, inner in value.items():
            if key != _SIGNING:
                yield from _names(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _names(inner)
    elif isinstance(value, str) and value:
        yield value.rpartition(":")[0] if ".py:" in value else value


def _files_of(name: str, beside: Path) -> Iterator[Path]:
    with suppress(OSError, ValueError, RuntimeError):  # a text that is no path at all
        path = _expanded(Path(name), beside)
        if is_file(path):
            yield from with_companions([path])
        elif is_folder(path) and not beside.resolve().is_relative_to(path.resolve()):
            yield from _files_of_folder(path)


def _expanded(name: Path, beside: Path) -> Path:
    """Return the absolute path that a name beside a document means. Raises RuntimeError."""
    return path_as_used(beside.parent.resolve() / name.expanduser())


def with_companions(paths: Iterable[Path]) -> list[Path]:
    """Return files and the files that meshes among them name, sorted. Raises OSError."""
    complete: set[Path] = set()
    waiting = list(paths)
    while waiting:
        path = waiting.pop()
        if path not in complete:
            complete.add(path)
            waiting.extend(path_as_used(one) for one in files_named_by_mesh(path))
    return sorted(complete)


def _files_of_folder(folder: Path) -> Iterator[Path]:
    """Yield the files that a run reads in a folder that a document names."""
    yield from sorted(path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES)
    if is_file(folder / _PX4_PROGRAM):
        yield folder / _PX4_PROGRAM
