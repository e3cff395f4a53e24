"""A run's files in a store: sent by the node that flew it, fetched by the campaign's machine.

Each order has its own place in the store. `begun` is written before the takeoff, then the run's
files with `result.json` as the last, and then `sent.json` with the SHA-256 of each. Without
`sent.json` nothing is fetched, and a file with another SHA-256 is refused.
"""

import hashlib
import json
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from wil_campaign.foundation.files.document_writer import sync_files
from wil_campaign.plugins.cluster.store import MissingFileError, Store, StoreError

RESULT_FILE = "result.json"
_BEGUN, _SENT, _GIVEN_UP = "begun", "sent.json", "given-up"
_NEWEST = "newest"
_CHUNK_BYTES = 1 << 20
_POLL_S = 1.0


class DamagedRunError(StoreError):
    """The files of a run in a store are not what its node has sent; says which."""


@dataclass(frozen=True, slots=True)
class _SentFile:
    """A file of a run as it was sent."""

    sha256: str
    size: int


def write_session(store: Store, campaign: str, session: str) -> None:
    """Write which start of a campaign may fly; nodes read it before each flight. Raises StoreError.

    campaign: its place in the store.
    """
    store.write(f"{campaign}/{_NEWEST}", session.encode())


def read_session(store: Store, campaign: str) -> str:
    """Return which start of a campaign may fly; "" if none is written. Raises StoreError."""
    return (store.read(f"{campaign}/{_NEWEST}") or b"").decode("utf-8", "replace")


def begin_run(store: Store, place: str, node: str) -> bool:
    """Write that a run begins on a node; return whether it may. Raises StoreError.

    The campaign's machine gives a run up in the reverse order: it writes that first, then reads
    whether the run has begun. So at least one of both sees the other.
    """
    store.write(f"{place}/{_BEGUN}", node.encode())
    return store.read(f"{place}/{_GIVEN_UP}") is None


def send_run(store: Store, place: str, folder: Path, sent: Callable[[int], None]) -> None:
    """Send the files of a run's folder, the result last. Raises StoreError, OSError.

    sent: called after each file with how many are sent.
    """
    paths = [path for path in folder.rglob("*") if path.is_file() and not path.is_symlink()]
    paths.sort(key=lambda path: (path == folder / RESULT_FILE, path))
    files: dict[str, dict[str, object]] = {}
    for number, path in enumerate(paths, start=1):
        name = path.relative_to(folder).as_posix()
        files[name] = {"sha256": stored_file_digest(path), "size": path.stat().st_size}
        store.upload(f"{place}/{name}", path)
        sent(number)
    store.write(f"{place}/{_SENT}", json.dumps({"files": files}).encode())


def fetch_run(store: Store, place: str, folder: Path, fetched: Callable[[int], None]) -> bool:
    """Write a run's files into a folder, the result last; return whether the run was sent.

    fetched: called after each file with how many are fetched. Raises DamagedRunError for a file
    that is missing or differs from what was sent, StoreError, and OSError.
    """
    files = _sent_files(store, place)
    if files is None:
        return False
    folder.mkdir(parents=True, exist_ok=True)
    names = sorted(files, key=lambda name: (name == RESULT_FILE, name))
    for number, name in enumerate(names, start=1):
        if name == RESULT_FILE:
            sync_files(folder)
        _fetch_file(store, f"{place}/{name}", folder / name, files[name])
        fetched(number)
    sync_files(folder)
    return True


def await_run(store: Store, place: str, folder: Path, *, landed_s: float, begun_s: float) -> str:
    """Fetch a run whose node is lost; return in words why it is missing, "" once it is here.

    landed_s: how long it may take to land and to be sent. begun_s: how long it may take to begin.
    Raises DamagedRunError, StoreError, OSError.
    """
    start_s = time.monotonic()
    has_begun = False
    while not fetch_run(store, place, folder, lambda _: None):
        has_begun = has_begun or store.read(f"{place}/{_BEGUN}") is not None
        passed_s = time.monotonic() - start_s
        if not has_begun and passed_s >= begun_s:
            store.write(f"{place}/{_GIVEN_UP}", b"")
            if store.read(f"{place}/{_BEGUN}") is None:
                return "it had not begun"
            has_begun = True
        if passed_s >= landed_s:
            return f"its node has sent nothing to {store.url}/{place} for {landed_s:g} s"
        time.sleep(_POLL_S)
    return ""


def stored_file_digest(path: Path) -> str:
    """Return the SHA-256 of a file in hex. Raises OSError."""
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while chunk := stream.read(_CHUNK_BYTES):
            digest.update(chunk)
    return digest.hexdigest()


def _sent_files(store: Store, place: str) -> Mapping[str, _SentFile] | None:
    """Return the sent files of a run, by name; None until all are sent.

    Raises DamagedRunError, StoreError.
    """
    content = store.read(f"{place}/{_SENT}")
    if content is None:
        return None
    try:
        files = json.loads(content)["files"]
        sent = {
            str(name): _SentFile(str(file["sha256"]), int(file["size"]))
            for name, file in files.items()
        }
    except (ValueError, KeyError, TypeError, AttributeError):
        return None  # some stores show a file while it is written
    for name in sent:
        parts = PurePosixPath(name).parts
        if not parts or name.startswith("/") or ".." in parts or "\\" in name:
            raise DamagedRunError(
                f"{store.url}/{place}/{_SENT} names a file outside of the run's folder: {name}"
            )
    return sent


def _fetch_file(store: Store, name: str, path: Path, wanted: _SentFile) -> None:
    """Write a file of the store, whole or not at all.

    Raises DamagedRunError, StoreError, OSError.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.part")
    try:
        for _ in range(store.limits.tries):
            store.download(name, part, wanted.size)
            if stored_file_digest(part) == wanted.sha256:
                _sync(part)
                part.replace(path)
                return
    except MissingFileError as error:
        raise DamagedRunError(str(error)) from error
    finally:
        part.unlink(missing_ok=True)
    raise DamagedRunError(f"{store.url}/{name} is not what its node has sent: its SHA-256 differs")


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
