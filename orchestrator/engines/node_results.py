"""Where a node leaves the results of runs: in a folder that it shares, or in a store.

With a store a run is flown into a folder of this machine, which stays until the campaign's machine
has its files. What cannot be sent stays for good, and the campaign is told where.
"""

import hashlib
import platform
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Protocol

from orchestrator.campaign.resuming.run_ledger import newest_session
from orchestrator.campaign.workers.run_workers import WorkerLost
from orchestrator.engines.node_messages import CampaignBrought, RunEnded, RunOrdered, RunTaken
from orchestrator.model.results import RunResult
from orchestrator.model.results_reader import ResultError, read_result
from orchestrator.state.run_setup import RunOrder
from orchestrator.storage.store import Store, StoreError, StoreRefusedError, open_store
from orchestrator.storage.stored_runs import RESULT_FILE, begin_run, read_session, send_run

GIVEN_UP = "the campaign's machine has given the run up"
RESUMED = "the campaign was resumed by another start meanwhile"


class NodeResults(Protocol):
    """Where a node leaves the results of one campaign's runs (protocol).

    What blocks is called in a thread. Raises nothing: what is wrong is said.
    """

    def problem(self) -> str:
        """Return why the campaign's machine would not get results; "" where it does."""

    def begin(self, ordered: RunOrdered) -> RunOrder | RunEnded:
        """Return the order as it is flown here, or how it ends because it may not be flown."""

    def end(
        self, ordered: RunOrdered, outcome: RunResult | WorkerLost, sent: Callable[[int], None]
    ) -> RunEnded:
        """Hand a run's files over. sent: told after each file how many."""

    def taken(self, message: RunTaken) -> None:
        """Take whether the campaign's machine has the files of a run."""

    def close(self) -> None:
        """Remove what the campaign's machine has, or can get."""


class SharedFolder:
    """The campaign's own folder, which this node sees under the same path."""

    def __init__(self, campaign: CampaignBrought) -> None:
        self._folder = Path(campaign.folder)
        self._session = campaign.session

    def problem(self) -> str:
        """Return why the folder is not the campaign's; "" where it is."""
        try:
            if newest_session(self._folder) == self._session:
                return ""
        except OSError as error:
            return f"{self._folder} cannot be read: {error}"
        return (
            f"it does not see {self._folder}: results come back by files; share the folder of "
            "--out with every node, under the same path, or give a store that all reach by --store"
        )

    def begin(self, ordered: RunOrdered) -> RunOrder | RunEnded:
        """Return the order, unless it was flown already."""
        order = ordered.order
        try:
            if newest_session(self._folder) != self._session:
                return RunEnded(WorkerLost(RESUMED))
            if not order.folder.is_dir() or not any(order.folder.iterdir()):
                return order
            result = read_result(order.folder / RESULT_FILE)
        except (ResultError, OSError) as error:
            return RunEnded(WorkerLost(f"its folder is there already, without a result: {error}"))
        return RunEnded(result, _digest(order.folder))

    def end(
        self,
        ordered: RunOrdered,
        outcome: RunResult | WorkerLost,
        sent: Callable[[int], None],  # noqa: ARG002  # all is there
    ) -> RunEnded:
        """Return how a run has ended, with the digest of its result."""
        return RunEnded(outcome, _digest(ordered.order.folder))

    def taken(self, message: RunTaken) -> None:
        """Do nothing: the files are where they belong."""

    def close(self) -> None:
        """Do nothing: the folder is the campaign's."""


class StoredResults:
    """A store at a URL, and folders of this machine until it has their files."""

    def __init__(self, campaign: CampaignBrought, store: Store) -> None:
        self._campaign = campaign
        self._store = store
        self._folders: dict[str, Path] = {}
        """Of runs, by their places: those that may be removed."""

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
            f"it does not see in {store.url} what the campaign's machine has written there: give a "
            "URL by --store that means the same store on every node"
        )

    def begin(self, ordered: RunOrdered) -> RunOrder | RunEnded:
        """Return the order with a folder of this machine, unless it may not be flown."""
        order, place = ordered.order, ordered.place
        try:
            # Before the look: who resumes the campaign writes there first, and looks here then.
            if not begin_run(self._store, place, platform.node()):
                return RunEnded(WorkerLost(GIVEN_UP))
            if read_session(self._store, self._campaign.place) != self._campaign.session:
                return RunEnded(WorkerLost(RESUMED))
            home = Path(tempfile.mkdtemp(prefix="wil-run-"))
        except (StoreError, OSError) as error:
            return RunEnded(WorkerLost(f"it was not flown: {error}"))
        self._folders[place] = home
        return replace(order, folder=home / order.folder.relative_to(self._campaign.folder))

    def end(
        self, ordered: RunOrdered, outcome: RunResult | WorkerLost, sent: Callable[[int], None]
    ) -> RunEnded:
        """Send a run's files; what cannot be sent is kept here, and the run is lost."""
        place = ordered.place
        home = self._folders[place]
        folder = home / ordered.order.folder.relative_to(self._campaign.folder)
        kept = f"{platform.node()}:{folder}"
        try:
            sha256 = _digest(folder)
            send_run(self._store, place, folder, sent)
        except (StoreError, OSError) as error:
            del self._folders[place]
            said = outcome.reason if isinstance(outcome, WorkerLost) else f"it is {outcome.verdict}"
            return RunEnded(
                WorkerLost(
                    f"{said}, but its files are not in the store, and kept in {kept}: {error}"
                )
            )
        return RunEnded(outcome, sha256, kept=kept)

    def taken(self, message: RunTaken) -> None:
        """Remove a run's folder once the campaign's machine has it; keep it where it has not."""
        home = self._folders.pop(message.place, None)
        if home is not None and message.is_there:
            shutil.rmtree(home, ignore_errors=True)

    def close(self) -> None:
        """Remove the folders of runs that are in the store, for a campaign that is resumed."""
        for home in self._folders.values():
            shutil.rmtree(home, ignore_errors=True)
        self._folders.clear()


def node_results(campaign: CampaignBrought) -> NodeResults | str:
    """Return where the results of a campaign go; in words why this node cannot."""
    if not campaign.store:
        return SharedFolder(campaign)
    try:
        return StoredResults(campaign, open_store(campaign.store))
    except StoreRefusedError as error:
        return str(error)


def _digest(folder: Path) -> str:
    """Return the SHA-256 of a run's result; "" where there is none."""
    try:
        return hashlib.sha256((folder / RESULT_FILE).read_bytes()).hexdigest()
    except OSError:
        return ""
