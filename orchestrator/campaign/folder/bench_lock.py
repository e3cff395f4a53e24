"""Locks of benches and of attached vehicles: one program at a time flies there.

A bench's file is locked. Of each link of an attached vehicle a file is locked beside this account's
sockets: where a router (mavlink-router, MAVProxy) serves a link that sends first, the system keeps
no second program from the vehicle, and each would set back what the other has set on board.
"""

import fcntl
import hashlib
import os
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from wil_campaign.campaigns.setup.bench_file import Bench
from wil_campaign.orchestrator.campaign.folder.campaign_folder import FolderTakenError, OutputError
from wil_campaign.safety.guard.process.runtime_folder import open_runtime_folder, runtime_folders
from wil_campaign.vehicles.links.link_strings import LinkAddress


@contextmanager
def held_benches(benches: Iterable[Bench]) -> Iterator[None]:
    """Lock benches of this machine until the context or the process ends.

    Raises TakenError for a bench in use by another process, and OSError.
    """
    with ExitStack() as stack:
        for bench in benches:
            handle = os.open(bench.document.path, os.O_RDONLY | os.O_CLOEXEC)
            stack.callback(os.close, handle)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise FolderTakenError(
                    f"bench {bench.name} is in use by another wil-campaign: wait until it has ended"
                ) from error
        yield


@contextmanager
def held_links(addresses: Iterable[LinkAddress]) -> Iterator[None]:
    """Lock links of attached vehicles for this account until the context or the process ends.

    Raises TakenError for a link in use by another process, and OutputError.
    """
    links = sorted({str(address) for address in addresses})
    with ExitStack() as stack:
        try:
            folders = {open_runtime_folder().path, *runtime_folders()} if links else set()
            for text in links:
                name = f"link-{hashlib.sha256(text.encode()).hexdigest()[:16]}.lock"
                for folder in sorted(folders):
                    stack.enter_context(_held_file(folder / name))
        except BlockingIOError as error:
            raise FolderTakenError(
                f"the vehicle at {text} is in use by another wil-campaign: wait until it has ended"
            ) from error
        except OSError as error:
            raise OutputError(f"the links of the vehicles cannot be locked: {error}") from error
        yield


@contextmanager
def _held_file(path: Path) -> Iterator[None]:
    """Lock a file, made for it, until the context or the process ends. Raises OSError."""
    handle = _lock_file(path)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(handle)


def _lock_file(path: Path) -> int:
    """Return the descriptor of a locked file. Raises BlockingIOError, OSError."""
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            with suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(handle), path.stat()):
                    return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)  # its holder removed it between the two calls
