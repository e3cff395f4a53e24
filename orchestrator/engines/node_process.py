"""The process on a node that flies the runs a machine sends it, each in a process of its own.

Its standard input brings messages, its standard output takes them: first the facts of the node, in
plain words, by which a machine with other programs refuses it. When standard input ends, for
the worker of Ray, its raylet, the head or the network is gone, the run in flight lands as aborted
and writes its result, and this process ends.
"""

import asyncio
import os
import select
import sys
import tempfile
from contextlib import suppress
from dataclasses import replace
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

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
    RunSending,
    RunTaken,
)
from orchestrator.engines.node_results import NodeResults, node_results
from orchestrator.engines.travelling_files import (
    DamagedFileError,
    place_beneath,
    relocate_order,
    unpack_files,
)
from orchestrator.model.progress import ProgressLimiter
from orchestrator.model.results import RunResult
from orchestrator.operator.local_commands import tell_guards
from orchestrator.state.run_setup import RunOrder
from orchestrator.storage.threads import in_thread
from safety.guard.core.operator_command import OperatorCommand

_SAY_S = 5.0
_DESERTED = "the node lost its cluster before the run began"
_LANDED_S = 120.0
"""How long a run may take to land that nobody waits for any longer."""
_PROGRESS_S = 0.5
"""Each message that crosses the cluster costs milliseconds of three processes."""


class NodeRuns:
    """Flies runs of one campaign on this node, one at a time. home: where its files are."""

    def __init__(self, commands: Connection, reports: Connection, home: Path) -> None:
        self._commands = commands
        self._reports = reports
        self._home = home
        self._workers = LocalWorkers[RunOrder, RunResult](fly_order)
        self._results: NodeResults | None = None

    async def serve(self) -> None:
        """Do what the messages ask for, until they end."""
        while True:
            try:
                message = await receive_message(self._commands)
            except (EOFError, OSError):
                return
            if isinstance(message, CampaignBrought):
                self._send(CampaignAnswer(await self._take_campaign(message)))
            elif isinstance(message, RunOrdered):
                self._send(await self._fly(message))
            elif isinstance(message, RunTaken) and self._results is not None:
                self._results.taken(message)

    def close(self) -> None:
        """Remove what is left of the campaign on this node, and is elsewhere as well."""
        if self._results is not None:
            self._results.close()

    async def _take_campaign(self, campaign: CampaignBrought) -> str:
        """Unpack a campaign's files; return why it cannot be flown here, "" where it can."""
        results = node_results(campaign)
        if isinstance(results, str):
            return results
        if problem := await in_thread(results.problem):
            return problem
        try:
            unpack_files(campaign.files, self._home)
        except (DamagedFileError, OSError) as error:
            return f"the campaign's files cannot be taken: {error}"
        beneath = [str(place_beneath(self._home, Path(f))) for f in campaign.files.search_path]
        sys.path[:0] = [one for one in beneath if one not in sys.path]
        self.close()
        self._results = results
        return ""

    async def _fly(self, ordered: RunOrdered) -> RunEnded:
        """Fly a run, unless it was flown already; return how it ended."""
        results = self._results
        if results is None:
            return RunEnded(WorkerLost("the node has no campaign"))
        order = await in_thread(lambda: results.begin(ordered))
        if isinstance(order, RunEnded):
            return order
        worker = await self._workers.start()
        if _is_deserted(self._commands):
            await worker.end()
            # Also to the store: who resumes or waits there learns that nothing comes any more.
            return await self._hand_over(results, ordered, WorkerLost(_DESERTED))
        async with asyncio.TaskGroup() as group:
            passing = group.create_task(
                self._pass_commands(worker, order.folder), name="commands to the run"
            )
            outcome = await self._follow(worker, relocate_order(order, self._home))
            passing.cancel()
        end_text = await worker.end()
        ended = await self._hand_over(results, ordered, outcome)
        return replace(ended, end_text=end_text)

    async def _hand_over(
        self, results: NodeResults, ordered: RunOrdered, outcome: RunResult | WorkerLost
    ) -> RunEnded:
        """Hand a run's files over, and say meanwhile that it goes on."""
        sent = 0

        def count(files: int) -> None:
            nonlocal sent
            sent = files

        sending = in_thread(lambda: results.end(ordered, outcome, count))
        while not sending.done():
            await asyncio.wait([sending], timeout=_SAY_S)
            if not sending.done():
                self._send(RunSending(sent))
        return sending.result()

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

    async def _pass_commands(self, worker: LocalWorker[RunOrder, RunResult], folder: Path) -> None:
        """Pass commands on to the run; their end is an abort. folder: the run's.

        An abort goes straight to the run's guard, too, past a run that may hang.
        """
        try:
            while True:
                message = await receive_message(self._commands)
                if not isinstance(message, OperatorCommand):
                    continue
                worker.send(message)
                if message.kind == "abort":
                    in_thread(partial(tell_guards, folder, message.who))
        except (EOFError, OSError):
            worker.send(OperatorCommand("abort", "the node: its cluster is gone"))
            await asyncio.sleep(_LANDED_S)
            worker.kill()  # it hangs: its guard has its vehicles

    def _send(self, message: object) -> None:
        with suppress(OSError):  # nobody is there: the run's files say what became of it
            self._reports.send(message)


def _is_deserted(commands: Connection) -> bool:
    """Return whether nobody is at the other end any more, whatever is left to read."""
    look = select.poll()
    look.register(commands.fileno(), 0)
    return any(event & select.POLLHUP for _, event in look.poll(0))


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
        runs = NodeRuns(commands, reports, Path(home))
        asyncio.run(runs.serve())
        runs.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
