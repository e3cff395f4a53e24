"""The run server: a process that has imported all that a run needs, and forks one for each run.

Every run so begins in the same state, whatever flew before it, and its process is there at once.
"""

import multiprocessing as mp
from multiprocessing import forkserver
from multiprocessing.context import ForkServerContext

_PREPARED = "orchestrator.campaign.workers.run_server_imports"


def run_context() -> ForkServerContext:
    """Return the context in which the processes of runs are forked from the run server."""
    context = mp.get_context("forkserver")
    context.set_forkserver_preload([_PREPARED])
    return context


def start_run_server() -> None:
    """Start the run server, unless it is there; it imports while its caller goes on."""
    run_context()
    forkserver.ensure_running()
