"""Reserves instance numbers of simulators, so that runs on one machine share no port."""

import errno
import fcntl
import os
import socket
import tempfile
from pathlib import Path
from typing import Self

from wil_campaign.vehicles.launch.launch_plan import Launch, LaunchError, Port


class Instance:
    """An instance number of one kind of simulator, reserved until it is closed.

    A file lock, which the kernel frees when its holder dies, excludes this user's other runs;
    other programs are detected by their ports.
    """

    def __init__(self, *, number: int, lock: int) -> None:
        self.number = number
        self._lock: int | None = lock

    def close(self) -> None:
        """Release the instance number."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def lock_folder() -> Path:
    """Return the folder of this user's instance locks."""
    return Path(tempfile.gettempdir()) / f"wil-campaign-{os.getuid()}"


def take_instance(launch: Launch, *, locks: Path | None = None) -> Instance:
    """Return a free instance of a kind of simulator. Raises LaunchError when there is none."""
    folder = lock_folder() if locks is None else locks
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    stem = "".join(character if character.isalnum() else "-" for character in launch.label.lower())
    taken: list[Port] = []
    for number in range(launch.instances):
        lock = _lock_instance(folder / f"{stem}-{number}.lock")
        if lock is None:
            continue
        busy = next((port for port in launch.ports(number) if not is_free(port)), None)
        if busy is None:
            return Instance(number=number, lock=lock)
        os.close(lock)
        taken.append(busy)
    used = ", ".join(f"{port.kind} {port.number}" for port in taken)
    raise LaunchError(
        f"{launch.label}: all {launch.instances} instances are in use"
        + (f" (ports in use by other programs: {used})" if used else "")
        + "; end orphaned simulators"
    )


def is_free(port: Port) -> bool:
    """Return whether an instance's port is not bound; no listener notices."""
    kind = socket.SOCK_STREAM if port.kind == "tcp" else socket.SOCK_DGRAM
    with socket.socket(socket.AF_INET, kind) as probe:
        if port.kind == "tcp":
            # As the simulators do: the last run's connections may still linger.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("", port.number))
        except OSError as error:
            if error.errno in {errno.EADDRINUSE, errno.EACCES}:
                return False
            raise
    return True


def _lock_instance(file: Path) -> int | None:
    handle = os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        return None
    return handle
