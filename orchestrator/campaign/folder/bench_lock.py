"""Lock of a bench: the program that flies on a bench locks its file."""

import fcntl
import os
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager

from wil_campaign.campaigns.setup.bench_file import Bench
from wil_campaign.orchestrator.campaign.folder.campaign_folder import FolderTakenError


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
