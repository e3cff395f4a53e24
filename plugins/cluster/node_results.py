"""Where a node leaves the results of runs: in a store.

A run is flown into a folder of this machine, which is kept until the campaign's machine has its
files. Files that cannot be sent are kept for good; the run's result says where.
"""

import platform
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from wil_campaign.orchestrator.campaign.workers.run_workers import WorkerLost
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder
from wil_campaign.plugins.cluster.node_messages import (
    CampaignBrought,
    RunEnded,
    RunOrdered,
    RunTaken,
)
from wil_campaign.plugins.cluster.returned_results import without_files
from wil_campaign.plugins.cluster.store import Store, StoreError, StoreRefusedError, open_store
from wil_campaign.plugins.cluster.stored_runs import (
    RESULT_FILE,
    begin_run,
    read_session,
    send_run,
    stored_file_digest,
)

GIVEN_UP = "the campaign's machine has given up the run"
RESUMED = "the campaign was resumed by another start meanwhile"


class StoredResults:
    """A store at a URL, and folders of this machine until it has their files.

    Blocking methods are called in a thread. They raise nothing: problems are returned.
    """

    def __init__(self, campaign: CampaignBrought, store: Store) -> None:
        self._campaign = campaign
        self._store = store
        self._folders: dict[str, Path] = {}
        """The folders of runs that may be removed, by their places in the store."""

    def problem(self) -> str:
        """Return why the store is not the campaign's; "" where it is."""
        store, place = self._store, self._campaign.place
        try:
            session = read_session(store, place)
        except StoreError as error:
            return str(error)
        if session == self._campaign.session:
            return ""
        return (
            f"it does not see in {store.url} what the campaign's machine wrote there: give a URL "
            "by --store that means the same store on every node"
        )

    def begin(self, ordered: RunOrdered) -> RunOrder | RunEnded:
        """Return the order with a folder of this machine, unless it may not be flown."""
        order, place = ordered.order, ordered.place
        try:
            # In this order: a resumed campaign first writes its session, then looks for begun runs.
            if not begin_run(self._store, place, platform.node()):
                return RunEnded.of(WorkerLost(GIVEN_UP))
            if read_session(self._store, self._campaign.place) != self._campaign.session:
                return RunEnded.of(WorkerLost(RESUMED))
            home = Path(tempfile.mkdtemp(prefix="wil-run-"))
        except (StoreError, OSError) as error:
            return RunEnded.of(WorkerLost(f"it was not flown: {error}"))
        self._folders[place] = home
        return replace(order, folder=home / order.folder.relative_to(self._campaign.folder))

    def end(
        self, ordered: RunOrdered, outcome: RunResult | WorkerLost, sent: Callable[[int], None]
    ) -> RunEnded:
        """Send a run's files; where that fails they are kept here, and the run is lost."""
        place = ordered.place
        home = self._folders[place]
        folder = home / ordered.order.folder.relative_to(self._campaign.folder)
        kept = f"{platform.node()}:{folder}"
        try:
            sha256 = _digest(folder)
            send_run(self._store, place, folder, sent)
        except (StoreError, OSError) as error:
            del self._folders[place]
            where = f"not in the store; they are kept in {kept}: {error}"
            return RunEnded.of(without_files(outcome, where))
        return RunEnded.of(outcome, sha256, kept=kept)

    def taken(self, message: RunTaken) -> None:
        """Remove a run's folder if the campaign's machine has its files."""
        home = self._folders.pop(message.place, None)
        if home is not None and message.is_there:
            shutil.rmtree(home, ignore_errors=True)

    def close(self) -> None:
        """Remove the folders of runs whose files are in the store: a resumed campaign gets them."""
        for home in self._folders.values():
            shutil.rmtree(home, ignore_errors=True)
        self._folders.clear()


def node_results(campaign: CampaignBrought) -> StoredResults | str:
    """Return where the results of a campaign go, or in words why this node has no access."""
    try:
        return StoredResults(campaign, open_store(campaign.store))
    except StoreRefusedError as error:
        return str(error)


def _digest(folder: Path) -> str:
    """Return the SHA-256 of a run's result; "" where there is none."""
    try:
        return stored_file_digest(folder / RESULT_FILE)
    except OSError:
        return ""
