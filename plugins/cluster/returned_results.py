"""How results of runs return to the campaign's machine: by a shared folder, or by a store."""

import time
import uuid
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from wil_campaign.orchestrator.campaign.folder.campaign_folder import (
    OutputError,
    TakenError,
    held_run,
    make_run_folder,
)
from wil_campaign.orchestrator.campaign.resuming.lost_runs import lost_result
from wil_campaign.orchestrator.campaign.workers.run_workers import WorkerLost
from wil_campaign.orchestrator.model.attempts import failed_too
from wil_campaign.orchestrator.model.document_writer import to_json, write_whole
from wil_campaign.orchestrator.model.results import RunResult
from wil_campaign.orchestrator.model.results_reader import ResultError, read_result
from wil_campaign.orchestrator.state.run_setup import RunOrder
from wil_campaign.plugins.cluster.node_messages import RunEnded
from wil_campaign.plugins.cluster.store import Store, StoreError
from wil_campaign.plugins.cluster.stored_runs import (
    RESULT_FILE,
    await_run,
    digest_of,
    fetch_run,
)

LANDED_S = 120.0
"""How long a run whose node has lost its worker may take to land."""
_BEGUN_S = 10.0
"""How long an order that was sent to a node before its loss may take to begin."""
_VISIBLE_S = 20.0
"""How long a shared folder may take to show files that a node has written."""
_POLL_S = 0.2


class ReturnedResults(Protocol):
    """How results of runs return here (protocol). Its methods block: they run in a thread."""

    def new_place(self, order: RunOrder) -> str:
        """Return a place for an order's files in the store; "" where there is none."""

    def of_ended(self, order: RunOrder, place: str, ended: RunEnded) -> RunResult | WorkerLost:
        """Return the outcome of a run that a node has ended, once its files are here."""

    def of_lost(self, order: RunOrder, place: str) -> RunResult | str:
        """Return the result of a run whose node is lost, or in words why there is none."""


class SharedResults:
    """Results in a shared folder: the nodes write into the runs' folders."""

    def new_place(self, order: RunOrder) -> str:  # noqa: ARG002  # its folder is its place
        """Return no place."""
        return ""

    def of_ended(
        self,
        order: RunOrder,
        place: str,  # noqa: ARG002
        ended: RunEnded,
    ) -> RunResult | WorkerLost:
        """Return the outcome once this machine sees the result as the node has written it."""
        path = order.folder / RESULT_FILE
        if isinstance(ended.outcome, RunResult) and not _becomes_visible(path, ended.sha256):
            return WorkerLost(
                f"{path} is not the file that the node wrote, after {_VISIBLE_S:g} s; share the "
                "folder of --out with every node",
                no_retry=_known_failure(ended.outcome),
            )
        return ended.outcome

    def of_lost(self, order: RunOrder, place: str) -> RunResult | str:  # noqa: ARG002
        """Return the result once no run uses its folder; without a result the run is given up.

        An order that was sent before, and begins only later, then is not flown.
        """
        had_begun = order.folder.is_dir()
        try:
            make_run_folder(order.folder, order.plan.name)
            for _ in range(round(LANDED_S / _POLL_S)):
                with suppress(TakenError), held_run(order.folder):
                    return _result_or_giving_up(order, had_begun=had_begun)
                time.sleep(_POLL_S)
        except (OutputError, OSError) as error:
            return str(error)
        return f"it was still in flight after {LANDED_S:g} s"


@dataclass(frozen=True, slots=True)
class FetchedResults:
    """Results in a store. campaign: the campaign's folder here; place: its place in the store."""

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
            elif digest_of(path) != ended.sha256:
                why = f"{path} is not the file that the node wrote: its SHA-256 differs"
            else:
                return ended.outcome
        except (StoreError, OSError) as error:
            why = str(error)
        if isinstance(ended.outcome, WorkerLost):
            lost = ended.outcome
            text = f"{lost.reason}; its files are kept in {ended.kept}: {why}"
            return replace(lost, reason=text)
        return WorkerLost(
            f"it is {ended.outcome.verdict}, but its files are not here; they are kept in "
            f"{ended.kept}: {why}",
            no_retry=_known_failure(ended.outcome),
        )

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


def _known_failure(result: RunResult) -> str:
    """Return why a run is not flown again though its files are lost; "" where it may be."""
    return failed_too(result.reason) if result.verdict == "FAIL" else result.no_retry


def _result_or_giving_up(order: RunOrder, *, had_begun: bool) -> RunResult | str:
    """Return the result in a run's locked folder, or give the run up there. Raises OSError."""
    path = order.folder / RESULT_FILE
    try:
        return read_result(path)
    except ResultError as error:
        why = str(error) if had_begun else "it had not begun"
        if not path.exists():
            write_whole(path, to_json(lost_result(order.plan, WorkerLost(why), order.folder)))
        return why


def _becomes_visible(path: Path, sha256: str) -> bool:
    """Return whether a file with this digest becomes visible in time."""
    for _ in range(round(_VISIBLE_S / _POLL_S)):
        try:
            if digest_of(path) == sha256:
                return True
        except OSError:
            pass
        time.sleep(_POLL_S)
    return False
