"""The folder for this user's sockets and records; one that others could replace is refused.

Where the usual folder is not ours alone (another user made it beforehand, it is a symbolic link,
others may write to it) the next place is used and the reason reported. Readers look in all places,
also in those of the user's other sessions.
"""

import contextlib
import errno
import os
import re
import socket
from dataclasses import dataclass
from pathlib import Path

from wil_campaign.foundation.files.own_folders import fault_of_folder, home_folder
from wil_campaign.foundation.processes.identity import ProcessId

_FOLDER = "wil-campaign"
_LOGINS = Path("/run/user")
"""Where systemd makes the XDG_RUNTIME_DIR of a login, by user id."""
_TEMPORARY = Path("/tmp")  # noqa: S108 - checked by fault_of_folder
_LONGEST_BYTES = 107 - len("/pymp-abcdefgh/listener-abcdefgh")
"""Of a folder whose sockets have paths that fit into sockaddr_un, unix(7).

Those of `multiprocessing` are longest.
"""
_LONGEST_BASE_BYTES = _LONGEST_BYTES - len(f"/{_FOLDER}")
_OF_PROCESS = re.compile(r"(?:campaign|guard|console)-([0-9]{1,10})(?:-[0-9a-f]+)?\.(?:sock|part)")


class RuntimeFolderError(OSError):
    """There is no safe folder for records and sockets; says why."""


@dataclass(frozen=True, slots=True)
class RuntimeFolder:
    """A folder of ours alone. passed_over: what is wrong with the places before it, in words."""

    path: Path
    passed_over: tuple[str, ...] = ()


def open_runtime_folder() -> RuntimeFolder:
    """Return the first safe place; it is made when it is not there. Raises RuntimeFolderError.

    XDG_RUNTIME_DIR where there is one that is short enough, else beneath /tmp; then beneath the
    user's home.
    """
    passed_over: list[str] = []
    for folder in _places():
        try:
            if passed_over:
                folder.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            folder.mkdir(mode=0o700, exist_ok=True)
            fault = fault_of_folder(folder)
        except OSError as error:
            fault = f"cannot be made: {error.strerror or error}"
        if not fault:
            return RuntimeFolder(folder, tuple(passed_over))
        passed_over.append(f"{folder} {fault}")
    raise RuntimeFolderError(
        f"no safe folder for sockets: {'; '.join(passed_over)}; remove it or set "
        f"XDG_RUNTIME_DIR to a folder of your own (at most {_LONGEST_BASE_BYTES} bytes)"
    )


def runtime_folders() -> tuple[Path, ...]:
    """Return all safe places that are there: a flight may have begun in any of them."""
    return tuple(
        folder for folder in _searched() if _is_there(folder) and not fault_of_folder(folder)
    )


def unsafe_folders() -> tuple[str, ...]:
    """Return what is wrong with the places that are there and not safe, in words."""
    found = ((folder, fault_of_folder(folder)) for folder in _searched() if _is_there(folder))
    return tuple(f"{folder} {fault}" for folder, fault in found if fault)


def sweep_runtime_folder(folder: Path) -> None:
    """Remove sockets and unfinished records of processes that are gone."""
    for path in folder.iterdir():
        named = _OF_PROCESS.fullmatch(path.name)
        if named is None or ProcessId.of(int(named[1])) is not None or is_socket_served(path):
            continue
        with contextlib.suppress(OSError):
            path.unlink()


def process_socket_path(folder: Path, what: str, process: ProcessId) -> Path:
    """Return the path of a process's socket, which no process of another container has."""
    return folder / f"{what}-{process.pid}-{process.started:x}.sock"


def is_socket_served(path: Path) -> bool:
    """Return whether a process listens at a socket, also one of a container that shares the folder.

    Its process id means nothing here. A listener that is busy counts.
    """
    for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM):
        with socket.socket(socket.AF_UNIX, kind) as end:
            end.setblocking(False)
            code = end.connect_ex(str(path))
        if code != errno.EPROTOTYPE:
            break
    return code in {0, errno.EAGAIN}


def is_too_long(base: str) -> bool:
    """Return whether XDG_RUNTIME_DIR is too long for the paths of our sockets."""
    return len(os.fsencode(base)) > _LONGEST_BASE_BYTES


def _places() -> tuple[Path, ...]:
    base = os.environ.get("XDG_RUNTIME_DIR", "")
    usual = Path(base) / _FOLDER
    if not base or is_too_long(base):
        usual = _usual_places()[1]
    # Its own folder: what else of ours is in the one above (parameter backups) others may read.
    home = home_folder()
    places = [usual] if home is None else [usual, home / ".local/state" / _FOLDER / "run"]
    return tuple(place for place in places if len(os.fsencode(place)) <= _LONGEST_BYTES)


def _searched() -> tuple[Path, ...]:
    """Return where a flight of this user may have begun: in a login, or in a shell without one.

    cron, `su` and `docker exec` set no XDG_RUNTIME_DIR. One of the user's own choice stands alone.
    """
    places = _places()
    usual = _usual_places()
    return tuple(dict.fromkeys((*places, *usual))) if {*places} & {*usual} else places


def _usual_places() -> tuple[Path, Path]:
    """Return the places of a login by systemd, and of a shell without XDG_RUNTIME_DIR."""
    return _LOGINS / str(os.getuid()) / _FOLDER, _TEMPORARY / f"{_FOLDER}-{os.getuid()}"


def _is_there(folder: Path) -> bool:
    try:
        folder.lstat()
    except OSError:
        return False
    return True
