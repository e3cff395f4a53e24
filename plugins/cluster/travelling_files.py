"""The files of a campaign that are copied to a node: packed, unpacked, and checked by SHA-256.

Beneath the folder where they are unpacked they have the layout of the machine that sent them, so
that every relative name in them stays valid. An absolute name means a file of the node, which has
to have the same content.
"""

import hashlib
import os
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from wil_campaign.orchestrator.campaign.folder.named_files import (
    path_as_used,
    with_companions,
)
from wil_campaign.orchestrator.campaign.workers.run_order import map_documents
from wil_campaign.orchestrator.state.run_setup import RunOrder
from wil_campaign.plugins.cluster.stored_runs import stored_file_digest


class DamagedFileError(Exception):
    """A file is not what was sent; says which."""


@dataclass(frozen=True, slots=True)
class TravellingFile:
    """One file. path: absolute on the machine that sends it. sha256: of its content, in hex."""

    path: Path
    sha256: str
    content: bytes
    is_executable: bool = False


@dataclass(frozen=True, slots=True)
class FileInPlace:
    """A file that is named absolutely. name: as documents have it, perhaps beginning with `~`."""

    name: Path
    sha256: str


@dataclass(frozen=True, slots=True)
class TravellingFiles:
    """Every file that a campaign's runs read. search_path: folders from which Python imports.

    in_place: the files among them that are read on each node at their own place.
    """

    files: tuple[TravellingFile, ...]
    search_path: tuple[Path, ...] = ()
    in_place: tuple[FileInPlace, ...] = ()


def pack_files(
    paths: Iterable[Path],
    search_path: Iterable[str],
    in_place: Iterable[tuple[Path, Path]] = (),
) -> TravellingFiles:
    """Return files with their content, by their absolute paths. Raises OSError.

    search_path: `sys.path` of this process; only folders above one of the files are kept. in_place:
    files that are named absolutely, as named and as they are here.
    """
    packed = tuple(_pack_file(path) for path in with_companions(map(path_as_used, paths)))
    folders = dict.fromkeys(path_as_used(Path(entry)) for entry in search_path)
    needed = [
        folder for folder in folders if any(file.path.is_relative_to(folder) for file in packed)
    ]
    digests = {file.path: file.sha256 for file in packed}
    named = (FileInPlace(name, digests[path]) for name, path in in_place if path in digests)
    return TravellingFiles(packed, tuple(needed), tuple(dict.fromkeys(named)))


def different_in_place(sent: TravellingFiles) -> str:
    """Return which file that is named absolutely is another one on this machine; "" for none."""
    for file in sent.in_place:
        try:
            path = file.name.expanduser()
            facts = path.stat()
            state = facts.st_size, facts.st_mtime_ns, facts.st_ino
            same = _digest_in_state(path, state) == file.sha256
        except (OSError, RuntimeError):
            same = False
        if not same:
            return (
                f"{file.name} is not the file that it is on the campaign's machine (its SHA-256 "
                "differs, or it is missing), and an absolute name means the node's own file: put "
                "the file beside the campaign and name it relative to that, so that it travels, or "
                "copy it to the same place on every node"
            )
    return ""


@lru_cache(maxsize=1000)
def _digest_in_state(path: Path, _state: tuple[int, int, int]) -> str:
    """Return the SHA-256 of a file, read once while it has the same size, time and inode."""
    return stored_file_digest(path)


def unpack_files(sent: TravellingFiles, folder: Path) -> None:
    """Write the files beneath a folder. Raises DamagedFileError, OSError."""
    for file in sent.files:
        if hashlib.sha256(file.content).hexdigest() != file.sha256:
            raise DamagedFileError(f"{file.path} arrived damaged: its SHA-256 does not match")
        target = place_beneath(folder, file.path)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(file.content)
        target.chmod(0o755 if file.is_executable else 0o644)


def place_beneath(folder: Path, path: Path) -> Path:
    """Return the path beneath a folder of a file that is absolute on the sending machine."""
    return folder / path.relative_to(path.anchor)


def relocate_order(order: RunOrder, folder: Path) -> RunOrder:
    """Return an order whose documents are beneath a folder."""
    there = map_documents(order, lambda one: replace(one, path=place_beneath(folder, one.path)))
    return replace(there, beneath=folder)


def _pack_file(path: Path) -> TravellingFile:
    content = path.read_bytes()
    digest = hashlib.sha256(content).hexdigest()
    return TravellingFile(path, digest, content, os.access(path, os.X_OK))
