"""The process on a node that flies the runs a machine sends it, each in a process of its own.

Its standard input brings messages, its standard output takes them: first the facts of the node, in
plain words, by which a machine with other programs refuses it. When standard input ends, for
the worker of Ray, its raylet, the head or the network is gone, the run in flight lands as aborted
and writes its result, and this process ends.
"""

import asyncio
import hashlib
import os
import sys
import tempfile
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path

from orchestrator.campaign.resuming.run_ledger import newest_session
from orchestrator.campaign.workers.local_workers import LocalWorker, LocalWorkers, receive_message
from orchestrator.campaign.workers.run_order import fly_order
from orchestrator.campaign.workers.run_server import start_run_server
from orchestrator.campaign.workers.run_workers import OrderDone, WorkerLost
from orchestrator.engines.node_facts import node_facts
from orchestrator.engines.node_messages import (
    CampaignAnswer,
    CampaignBrought,
    RunEnded,
    RunOrdered,
)
from orchestrator.engines.travelling_files import (
    DamagedFileError,
    place_beneath,
    relocate_order,
    unpack_files,
)
from orchestrator.model.progress import ProgressLimiter
from orchestrator.model.results import RunResult
from orchestrator.model.results_reader import ResultError, read_result
from orchestrator.state.run_setup import RunOrder
from safety.guard.core.operator_command import OperatorCommand

_RESULT = "result.json"
_PROGRESS_S = 0.5
"""Each message that crosses the cluster costs milliseconds of three processes."""


class NodeRuns:
    """Flies runs of one campaign on this node, one at a time. home: where its files are."""

    def __init__(self, commands: Connection, reports: Connection, home: Path) -> None:
        self._commands = commands
        self._reports = reports
        self._home = home
        self._workers = LocalWorkers[RunOrder, RunResult](fly_order)
        self._campaign: CampaignBrought | None = None

    async def serve(self) -> None:
        """Do what the messages ask for, until they end."""
        while True:
            try:
                message = await receive_message(self._commands)
            except (EOFError, OSError):
                return
            if isinstance(message, CampaignBrought):
                self._send(CampaignAnswer(self._take_campaign(message)))
            elif isinstance(message, RunOrdered):
                self._send(await self._fly(message.order))

    def _take_campaign(self, campaign: CampaignBrought) -> str:
        """Unpack a campaign's files; return why it cannot be flown here, "" where it can."""
        try:
            if newest_session(Path(campaign.folder)) != campaign.session:
                return (
                    f"it does not see {campaign.folder}: results come back by files; share the "
                    "folder of --out with every node, under the same path"
                )
            unpack_files(campaign.files, self._home)
        except (DamagedFileError, OSError) as error:
            return f"the campaign's files cannot be taken: {error}"
        beneath = [str(place_beneath(self._home, Path(f))) for f in campaign.files.search_path]
        sys.path[:0] = [one for one in beneath if one not in sys.path]
        self._campaign = campaign
        return ""

    async def _fly(self, order: RunOrder) -> RunEnded:
        """Fly a run, unless it was flown already; return how it ended."""
        refused = self._refusal(order)
        if refused is not None:
            return refused
        worker = await self._workers.start()
        async with asyncio.TaskGroup() as group:
            passing = group.create_task(self._pass_commands(worker), name="commands to the run")
            outcome = await self._follow(worker, relocate_order(order, self._home))
            passing.cancel()
        ended = await worker.end()
        return RunEnded(outcome, _digest(order.folder / _RESULT), ended)

    def _refusal(self, order: RunOrder) -> RunEnded | None:
        """Return how an order ends that must not be flown; None for one that must."""
        campaign = self._campaign
        if campaign is None:
            return RunEnded(WorkerLost("the node has no campaign"))
        try:
            if newest_session(Path(campaign.folder)) != campaign.session:
                return RunEnded(WorkerLost("the campaign was resumed by another start meanwhile"))
            if not order.folder.is_dir() or not any(order.folder.iterdir()):
                return None
            result = read_result(order.folder / _RESULT)
        except (ResultError, OSError) as error:
            return RunEnded(WorkerLost(f"its folder is there already, without a result: {error}"))
        return RunEnded(result, _digest(order.folder / _RESULT))

    async def _follow(
        self, worker: LocalWorker[RunOrder, RunResult], order: RunOrder
    ) -> RunResult | WorkerLost:
        """Have a worker fly an order, and pass its messages on until the run is done."""
        limiter = ProgressLimiter(_PROGRESS_S)
        try:
            await worker.begin(order)
            while True:
                message = await worker.receive()
                if isinstance(message, OrderDone):
                    outcome: RunResult | WorkerLost = message.outcome
                    return outcome
                if limiter.passes(message):
                    self._send(message)
        except (EOFError, OSError):
            return await worker.outcome_of_lost("")

    async def _pass_commands(self, worker: LocalWorker[RunOrder, RunResult]) -> None:
        """Pass commands on to the run; their end is an abort."""
        try:
            while True:
                message = await receive_message(self._commands)
                if isinstance(message, OperatorCommand):
                    worker.send(message)
        except (EOFError, OSError):
            worker.send(OperatorCommand("abort", "the node: its cluster is gone"))

    def _send(self, message: object) -> None:
        with suppress(OSError):  # nobody is there: the run's files say what became of it
            self._reports.send(message)


def main() -> int:
    """Serve the machine at the other end of standard input and output."""
    commands, reports = Connection(os.dup(0), writable=False), Connection(os.dup(1), readable=False)
    # What a file of the user's prints is no message, and no child of ours may read the commands.
    os.dup2(2, 1)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    start_run_server()
    reports.send(node_facts())
    with tempfile.TemporaryDirectory(prefix="wil-campaign-") as home:
        asyncio.run(NodeRuns(commands, reports, Path(home)).serve())
    return 0


def _digest(path: Path) -> str:
    """Return the SHA-256 of a run's result; "" where there is none."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""


if __name__ == "__main__":
    sys.exit(main())
