"""How results of runs return to the campaign's machine: through a store."""

import uuid
from dataclasses import dataclass, replace
from pathlib import Path

from wil_campaign.orchestrator.campaign.workers.run_workers import WorkerLost
from wil_campaign.orchestrator.run_results.attempts import failed_too_text, no_retry_text
from wil_campaign.orchestrator.run_results.result_reader import ResultError, read_result
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder
from wil_campaign.plugins.cluster.node_messages import RunEnded
from wil_campaign.plugins.cluster.store import Store, StoreError
from wil_campaign.plugins.cluster.stored_runs import (
    RESULT_FILE,
    await_run,
    fetch_run,
    stored_file_digest,
)

LANDED_S = 120.0
"""How long a run whose node has lost its worker may take to land."""
_BEGUN_S = 10.0
"""How long an order that was sent to a node before its loss may take to begin."""


@dataclass(frozen=True, slots=True)
class FetchedResults:
    """Results in a store. campaign: the campaign's folder here; place: its place in the store.

    Its methods block: they run in a thread.
    """

    store: Store
    campaign: Path
    place: str

    def new_place(self, order: RunOrder) -> str:
        """Return a unique place."""
        run = order.folder.relative_to(self.campaign).as_posix()
        return f"{self.place}/{run}/{uuid.uuid4().hex[:12]}"

    def of_ended(self, order: RunOrder, place: str, ended: RunEnded) -> RunResult | WorkerLost:
        """Return the outcome once all files are here with the digests that were sent."""
        if not ended.kept:
            return ended.outcome
        try:
            is_there = fetch_run(self.store, place, order.folder, lambda _: None)
            path = order.folder / RESULT_FILE
            if isinstance(ended.outcome, WorkerLost):
                return ended.outcome
            if not is_there:
                why = f"{self.store.url}/{place} no longer has its files"
            elif stored_file_digest(path) != ended.sha256:
                why = f"{path} is not the file that the node wrote: its SHA-256 differs"
            else:
                return ended.outcome
        except (StoreError, OSError) as error:
            why = str(error)
        return without_files(ended.outcome, f"not here; they are kept in {ended.kept}: {why}")

    def of_lost(self, order: RunOrder, place: str) -> RunResult | str:
        """Return the result that a node stores after it has lost its worker."""
        try:
            why = await_run(self.store, place, order.folder, landed_s=LANDED_S, begun_s=_BEGUN_S)
            path = order.folder / RESULT_FILE
            if not why and not path.exists():
                return "its node has sent no result: it had not begun to fly, or was killed"
            return why or read_result(path)
        except (StoreError, ResultError, OSError) as error:
            return str(error)


def without_files(outcome: RunResult | WorkerLost, where: str) -> WorkerLost:
    """Return the outcome of a run whose files are missing. where: they are instead, and why.

    What is known without them keeps a run that failed from another flight.
    """
    if isinstance(outcome, WorkerLost):
        return replace(outcome, reason=f"{outcome.reason}; its files are {where}")
    is_fail = outcome.verdict == "FAIL"
    return WorkerLost(
        f"it is {outcome.verdict}, but its files are {where}",
        no_retry=failed_too_text(outcome.reason) if is_fail else no_retry_text(outcome),
    )
