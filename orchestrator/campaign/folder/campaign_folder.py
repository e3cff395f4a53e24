"""A campaign's folder on the disk: made, held while it is flown, runs set aside in it.

Beneath it each run has `<case>/<mode>/<rep>`. What was flown there before and does not count is
kept in `earlier/<case>/<mode>/<rep>-<n>`, n from 1.
"""

import contextlib
import fcntl
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from orchestrator.model.document_writer import sync_folder
from orchestrator.recording.timestamps import folder_stamp

_EARLIER = "earlier"


class OutputError(Exception):
    """A campaign's results cannot be written; says where and why."""


class TakenError(Exception):
    """A campaign folder is in use by another process."""


def make_folder(parent: Path) -> Path:
    """Make and return a new campaign folder, named by the time. Raises OutputError."""
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
    raise OutputError(f"{parent} has 1000 folders of this second already")


def require_writable(out: Path, *, junit: Path | None) -> None:
    """Check that a campaign's results can be written before it begins. Raises OutputError.

    out: made when it is not there; junit: a file in a folder that is there.
    """
    there = next((one for one in (out, *out.absolute().parents) if one.exists()), out)
    try:
        with tempfile.TemporaryDirectory(dir=there, prefix=".wil-"):
            pass
    except OSError as error:
        raise OutputError(
            f"the results cannot be written to {out}: {error.strerror or error}; choose another "
            "place by --out"
        ) from error
    if junit is None:
        return
    if not junit.parent.is_dir():
        raise OutputError(
            f"junit.xml cannot be written to {junit}: there is no folder {junit.parent}; make it, "
            "or choose another place by --junit"
        )
    if junit.is_dir():
        raise OutputError(f"junit.xml cannot be written to {junit}: it is a folder; name a file")
    try:
        with tempfile.TemporaryFile(dir=junit.parent):
            pass
    except OSError as error:
        said = error.strerror or error
        raise OutputError(f"junit.xml cannot be written to {junit}: {said}") from error


def newest_folder(parent: Path) -> Path | None:
    """Return the campaign folder that was begun last; None without one."""
    folders = [path.parent for path in parent.glob("*/campaign.json")]
    return max(folders, key=_moment, default=None)


def make_run_folder(folder: Path, run: str) -> None:
    """Make a run's folder durably; run: the end of its name.

    Raises OutputError.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for parent in folder.parents[: len(Path(run).parts)]:
            sync_folder(parent)
    except OSError as error:
        raise OutputError(f"{folder} cannot be created: {error.strerror or error}") from error


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Lock a campaign folder for this process, until it ends at the latest. Raises TakenError.

    The kernel lets it go when the process dies, whatever it dies of.
    """
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise TakenError(f"{folder} is in use by another wil-campaign") from error
        except OSError:
            # A file system without locks: nothing says that anybody is there.
            pass
        yield
    finally:
        os.close(handle)


def set_aside(campaign: Path, run: str) -> Path:
    """Move a run's folder to those of uncounted attempts; return where. Raises OSError."""
    place = campaign / _EARLIER / run
    number = len(earlier_folders(campaign, run)) + 1
    target = place.with_name(f"{place.name}-{number}")
    target.parent.mkdir(parents=True, exist_ok=True)
    (campaign / run).rename(target)
    for folder in (target.parent, (campaign / run).parent):
        sync_folder(folder)
    return target


def earlier_folders(campaign: Path, run: str) -> list[Path]:
    """Return the folders of earlier attempts at a run, oldest first."""
    place = campaign / _EARLIER / run
    found: list[Path] = []
    while (folder := place.with_name(f"{place.name}-{len(found) + 1}")).is_dir():
        found.append(folder)
    return found


def _moment(folder: Path) -> tuple[str, int]:
    """Return the sort key of a campaign folder: the second it was begun in, and its number."""
    stamp, _, number = folder.name.partition("-")
    return stamp, int(number) if number.isdecimal() else 1
