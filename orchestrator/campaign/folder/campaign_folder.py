"""A campaign's folder on the disk: created, locked while it is flown, with runs set aside in it.

Beneath it each run has `<case>/<mode>/<rep>`. Earlier attempts, which do not count, are kept in
`earlier/<case>/<mode>/<rep>-<n>`, n from 1. What is locked are files, `.lock` in the campaign's
folder and `.<rep>.lock` beside a run's: over NFS, Linux keeps locks of folders to one machine.
"""

import contextlib
import fcntl
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from wil_campaign.foundation.files.document_writer import (
    require_own_file,
    sync_folder,
    write_atomically,
)
from wil_campaign.foundation.files.paths import path_exists, require_utf8
from wil_campaign.foundation.files.problems import BadInput, Problem
from wil_campaign.orchestrator.recording.timestamps import folder_stamp

_EARLIER = "earlier"
_NAME_BYTES, _PATH_BYTES = 255, 4095
"""The longest name and the longest path that Linux takes."""
_BENEATH_BYTES = 500
"""Room for what a campaign writes beneath --out: its name, its start, case, mode, run and file."""
_LOCK = ".lock"
_JUNIT, _JUNIT_BEGINS = b"<testsuites", 100
"""By what it is known that a file is a junit.xml, within so many bytes of its beginning."""


class OutputError(Exception):
    """A campaign's results cannot be written; says where and why."""


class FolderTakenError(Exception):
    """A campaign folder is in use by another process."""


def make_campaign_folder(parent: Path) -> Path:
    """Create and return a new campaign folder, named by the time. Raises OutputError."""
    stamp = folder_stamp(time.time())
    try:
        parent.mkdir(parents=True, exist_ok=True)
        for name in (stamp, *(f"{stamp}-{number}" for number in range(2, 1000))):
            with contextlib.suppress(FileExistsError):
                (parent / name).mkdir()
                sync_folder(parent)
                return parent / name
    except OSError as error:
        reason = error.strerror or error
        raise OutputError(
            f"the results cannot be written to {parent}: {reason}; choose another folder with --out"
        ) from error
    raise OutputError(f"{parent} already has 1000 folders of this second")


def remove_earlier_junit(path: Path) -> None:
    """Remove the junit.xml of an earlier campaign: one that is refused must not seem to be it."""
    with contextlib.suppress(OSError):  # whoever writes there says why not
        if path.is_file():
            with path.open("rb") as file:
                begins = file.read(_JUNIT_BEGINS)
            if _JUNIT in begins:
                path.unlink()


def require_writable_results(out: Path, *, junit: Path | None) -> None:
    """Check that a campaign's results can be written before it begins.

    out: created when it does not exist; junit: a file in an existing folder. Raises OutputError,
    and BadInput for a path that is not UTF-8 or too long, and for another kind of file at `junit`.
    """
    try:
        require_utf8(out)
        if _is_too_long(out.absolute()):
            message = "is too long for a folder of results: choose another one with --out"
            raise BadInput([Problem(str(out), 0, 0, message)])
        existing = next((path for path in (out, *out.absolute().parents) if path_exists(path)), out)
        with tempfile.TemporaryDirectory(dir=existing, prefix=".wil-"):
            pass
    except OSError as error:
        raise OutputError(
            f"the results cannot be written to {out}: {error.strerror or error}; choose another "
            "folder with --out"
        ) from error
    if junit is None:
        return
    require_own_file(junit, rb"(<\?xml[^>]*>\s*)?<testsuite")
    if not junit.parent.is_dir():
        raise OutputError(
            f"junit.xml cannot be written to {junit}: there is no folder {junit.parent}; create "
            "it, or choose another place with --junit"
        )
    if junit.is_dir():
        raise OutputError(f"junit.xml cannot be written to {junit}: it is a folder; name a file")
    try:
        with tempfile.TemporaryFile(dir=junit.parent):
            pass
    except OSError as error:
        reason = error.strerror or error
        raise OutputError(f"junit.xml cannot be written to {junit}: {reason}") from error


def _is_too_long(out: Path) -> bool:
    """Return whether paths of results beneath a folder would be too long for the system."""
    longest = max(len(os.fsencode(name)) for name in out.parts)
    return longest > _NAME_BYTES or len(os.fsencode(out)) > _PATH_BYTES - _BENEATH_BYTES


def newest_campaign_folder(parent: Path) -> Path | None:
    """Return the newest campaign folder; None without one."""
    folders = [path.parent for path in parent.glob("*/campaign.json")]
    return max(folders, key=_start_key, default=None)


def make_run_folder(folder: Path, run: str) -> None:
    """Create a run's folder durably. run: its path beneath the campaign's. Raises OutputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for parent in folder.parents[: len(Path(run).parts)]:
            sync_folder(parent)
    except OSError as error:
        raise OutputError(f"{folder} cannot be created: {error.strerror or error}") from error


def write_campaign_document(path: Path, content: str | bytes) -> None:
    """Write a document of the campaign. Raises OutputError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, content)
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror or error}") from error


def locked_campaign_folder(folder: Path) -> AbstractContextManager[None]:
    """Lock a campaign's folder until the context or the process ends.

    Raises TakenError, and OSError where its file cannot be written.
    """
    return _locked(folder / _LOCK, folder)


def locked_run_folder(folder: Path) -> AbstractContextManager[None]:
    """Lock a run's folder, whatever is in it, until the context or the process ends.

    Raises TakenError, and OSError where the file beside it cannot be written.
    """
    return _locked(folder.with_name(f".{folder.name}{_LOCK}"), folder)


@contextmanager
def _locked(file: Path, folder: Path) -> Iterator[None]:
    """Lock a file, which stays. The kernel releases it when the process dies for any reason."""
    handle = os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise FolderTakenError(f"{folder} is in use by another wil-campaign") from error
        except OSError:
            # A file system without locks cannot tell whether the folder is in use.
            pass
        yield
    finally:
        os.close(handle)


def set_run_folder_aside(campaign: Path, run: str) -> Path:
    """Move a run's folder to the earlier attempts; return its new path. Raises OSError."""
    place = campaign / _EARLIER / run
    number = len(earlier_attempt_folders(campaign, run)) + 1
    target = place.with_name(f"{place.name}-{number}")
    target.parent.mkdir(parents=True, exist_ok=True)
    (campaign / run).rename(target)
    for folder in (target.parent, (campaign / run).parent):
        sync_folder(folder)
    return target


def earlier_attempt_folders(campaign: Path, run: str) -> list[Path]:
    """Return the folders of earlier attempts at a run, oldest first."""
    place = campaign / _EARLIER / run
    folders: list[Path] = []
    while (folder := place.with_name(f"{place.name}-{len(folders) + 1}")).is_dir():
        folders.append(folder)
    return folders


def _start_key(folder: Path) -> tuple[str, int]:
    """Return the sort key of a campaign folder: the second of its start, and its number."""
    stamp, _, number = folder.name.partition("-")
    return stamp, int(number) if number.isdecimal() else 1
