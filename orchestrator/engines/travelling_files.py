"""The files of a campaign that travel to a node by value: packed, checked, unpacked, found again.

Beneath the folder where they are unpacked they stand as they stand on the machine that sent them,
so that every relative name in them holds.
"""

import hashlib
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from campaigns.setup.case_files import CaseFiles
from orchestrator.campaign.folder.named_files import with_companions
from orchestrator.state.run_setup import RunOrder
from worlds.files.documents import Document


class DamagedFileError(Exception):
    """A file is not what was sent; says which."""


@dataclass(frozen=True, slots=True)
class TravellingFile:
    """One file. path: absolute on the machine that sends it. sha256: of its content, in hex."""

    path: str
    sha256: str
    content: bytes
    is_executable: bool = False


@dataclass(frozen=True, slots=True)
class TravellingFiles:
    """All that the runs of a campaign read. search_path: folders from which Python imports them."""

    files: tuple[TravellingFile, ...]
    search_path: tuple[str, ...] = ()


def pack_files(paths: Iterable[Path], search_path: Iterable[str]) -> TravellingFiles:
    """Return files to travel, by their absolute paths. Raises OSError.

    search_path: `sys.path` of this process; of it only folders above one of the files travel.
    """
    packed = tuple(_packed(path) for path in with_companions(paths))
    folders = dict.fromkeys(str(Path(entry).resolve()) for entry in search_path)
    needed = [one for one in folders if any(Path(f.path).is_relative_to(one) for f in packed)]
    return TravellingFiles(packed, tuple(needed))


def unpack_files(sent: TravellingFiles, folder: Path) -> None:
    """Write the files beneath a folder. Raises DamagedFileError, OSError."""
    for file in sent.files:
        if hashlib.sha256(file.content).hexdigest() != file.sha256:
            raise DamagedFileError(f"{file.path} arrived damaged: its SHA-256 is another")
        target = place_beneath(folder, Path(file.path))
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(file.content)
        target.chmod(0o755 if file.is_executable else 0o644)


def place_beneath(folder: Path, path: Path) -> Path:
    """Return where a file, absolute on the sending machine, stands beneath a folder."""
    return folder / path.relative_to(path.anchor)


def relocate_order(order: RunOrder, folder: Path) -> RunOrder:
    """Return an order whose documents stand beneath a folder."""
    return replace(order, plan=replace(order.plan, files=_relocate_case(order.plan.files, folder)))


def resolve_order(order: RunOrder) -> RunOrder:
    """Return an order in which every path is absolute, and so means the same on a node."""
    plan = replace(order.plan, files=_resolve_case(order.plan.files))
    return replace(order, plan=plan, folder=order.folder.absolute())


def _packed(path: Path) -> TravellingFile:
    content = path.read_bytes()
    digest = hashlib.sha256(content).hexdigest()
    return TravellingFile(str(path), digest, content, os.access(path, os.X_OK))


def _relocate_case(files: CaseFiles, folder: Path) -> CaseFiles:
    """Return a case's documents with their paths beneath a folder."""
    return _with_paths(
        files, {one.path: place_beneath(folder, one.path) for one in _documents(files)}
    )


def _resolve_case(files: CaseFiles) -> CaseFiles:
    """Return a case's documents with absolute paths."""
    return _with_paths(files, {one.path: one.path.resolve() for one in _documents(files)})


def _documents(files: CaseFiles) -> list[Document]:
    given = (files.campaign, files.world, files.recipe, *files.fences.values())
    return [one for one in given if one is not None]


def _with_paths(files: CaseFiles, places: Mapping[Path, Path]) -> CaseFiles:
    """Return a case's documents with other paths."""

    def moved(document: Document) -> Document:
        return replace(document, path=places[document.path])

    return CaseFiles(
        campaign=moved(files.campaign),
        world=None if files.world is None else moved(files.world),
        recipe=None if files.recipe is None else moved(files.recipe),
        fences={name: moved(one) for name, one in files.fences.items()},
    )
