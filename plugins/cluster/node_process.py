"""The process on a node that flies the runs of a campaign, each in a process of its own.

It reads messages from standard input and writes messages to standard output. The first one it
writes has the facts of the node, by which a machine with other programs refuses the node. When
standard input ends (Ray's worker, its raylet, the head or the network is gone), the run in flight
lands as aborted and writes its result, and this process ends.
"""

import asyncio
import os
import select
import sys
import tempfile
from contextlib import suppress
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

from msgspec.structs import replace

from wil_campaign.orchestrator.campaign.workers.local_workers import (
    LocalWorker,
    LocalWorkers,
    await_message,
)
from wil_campaign.orchestrator.campaign.workers.run_order import (
    completed_run,
    flies_processes,
    fly_order,
)
from wil_campaign.orchestrator.campaign.workers.run_server import start_run_server
from wil_campaign.orchestrator.campaign.workers.run_workers import OrderDone, WorkerLost
from wil_campaign.orchestrator.operator.local_commands import tell_guards
from wil_campaign.orchestrator.operator.run_messages import News, ProgressLimiter
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder
from wil_campaign.plugins.cluster.node_facts import node_facts
from wil_campaign.plugins.cluster.node_messages import (
    CampaignAnswer,
    CampaignBrought,
    CommandSent,
    NodeFacts,
    RunEnded,
    RunOrdered,
    RunSending,
    RunTaken,
    ToCampaign,
    ToNode,
    decode_to_node,
    encode_to_campaign,
    news_message,
)
from wil_campaign.plugins.cluster.node_results import StoredResults, node_results
from wil_campaign.plugins.cluster.threads import call_in_daemon_thread
from wil_campaign.plugins.cluster.travelling_files import (
    DamagedFileError,
    different_in_place,
    place_beneath,
    relocate_order,
    unpack_files,
)
from wil_campaign.safety.guard.core.operator_command import OperatorCommand

_REPORT_S = 5.0
_AT_ONCE_BYTES = select.PIPE_BUF - 4
"""A pipe that is ready takes so many without blocking, behind the length of the message."""
_DESERTED = "the node lost its cluster before the run began"
_LANDED_S = 120.0
"""How long a run may take to land once its cluster is gone."""
_PROGRESS_S = 0.5
"""Each message that crosses the cluster costs milliseconds of three processes."""


class NodeRuns:
    """Flies runs of one campaign on this node, one at a time. home: where its files are."""

    def __init__(self, commands: Connection, reports: Connection, home: Path) -> None:
        self._commands = commands
        self._reports = reports
        self._home = home
        self._workers = LocalWorkers[RunOrder, RunResult](fly_order, completed_run, flies_processes)
        self._results: StoredResults | None = None
        self._sending: asyncio.Future[None] | None = None

    async def serve(self) -> None:
        """Carry out the messages until standard input ends."""
        try:
            await self._serve()
        finally:
            await self._workers.close()

    async def _serve(self) -> None:
        while True:
            try:
                message = await self._receive()
            except (EOFError, OSError):
                return
            if isinstance(message, CampaignBrought):
                await self._send(CampaignAnswer(await self._take_campaign(message)))
            elif isinstance(message, RunOrdered):
                await self._send(await self._fly(message))
            elif isinstance(message, RunTaken) and self._results is not None:
                self._results.taken(message)

    def close(self) -> None:
        """Remove the campaign's files on this node that the campaign's machine has or can get."""
        if self._results is not None:
            self._results.close()

    async def _take_campaign(self, campaign: CampaignBrought) -> str:
        """Unpack a campaign's files; return why it cannot be flown here, "" where it can."""
        results = node_results(campaign)
        if isinstance(results, str):
            return results
        try:
            start_run_server()  # it imports for a second; many a node process gets no campaign
        except OSError as error:
            return f"its run server cannot be started: {error}"
        for problem_of in (results.problem, partial(different_in_place, campaign.files)):
            if problem := await call_in_daemon_thread(problem_of):
                return problem
        try:
            unpack_files(campaign.files, self._home)
        except (DamagedFileError, OSError) as error:
            return f"the campaign's files cannot be unpacked: {error}"
        folders = [str(place_beneath(self._home, path)) for path in campaign.files.search_path]
        sys.path[:0] = [folder for folder in folders if folder not in sys.path]
        self.close()
        self._results = results
        return ""

    async def _fly(self, ordered: RunOrdered) -> RunEnded:
        """Fly a run, unless it was flown already; return how it ended."""
        results = self._results
        if results is None:
            return RunEnded.of(WorkerLost("the node has no campaign"))
        order = await call_in_daemon_thread(lambda: results.begin(ordered))
        if isinstance(order, RunEnded):
            return order
        worker = await self._workers.start()
        if _is_deserted(self._commands):
            await worker.end()
            # Also to the store: a campaign that waits there or is resumed then waits no longer.
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
        self, results: StoredResults, ordered: RunOrdered, outcome: RunResult | WorkerLost
    ) -> RunEnded:
        """Hand a run's files over, and report meanwhile how many are sent."""
        sent = 0

        def count(files: int) -> None:
            nonlocal sent
            sent = files

        sending = call_in_daemon_thread(lambda: results.end(ordered, outcome, count))
        while not sending.done():
            await asyncio.wait([sending], timeout=_REPORT_S)
            if not sending.done():
                await self._report(RunSending(sent))
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
                if isinstance(message, News) and limiter.passes(message):
                    await self._report(news_message(message))
        except (EOFError, OSError):
            return await worker.outcome_of_lost("")

    async def _pass_commands(self, worker: LocalWorker[RunOrder, RunResult], folder: Path) -> None:
        """Pass commands on to the run; their end is an abort. folder: the run's.

        An abort goes straight to the run's guard, too, past a run that may hang.
        """
        try:
            while True:
                message = await self._receive()
                if not isinstance(message, CommandSent):
                    continue
                worker.send(message.command)
                if message.command.kind == "abort":
                    call_in_daemon_thread(partial(tell_guards, folder, message.command.who))
        except (EOFError, OSError):
            worker.send(OperatorCommand("abort", "the node: its cluster is gone"))
            await asyncio.sleep(_LANDED_S)
            worker.kill()  # it hangs: its guard controls its vehicles

    async def _receive(self) -> ToNode:
        """Return the next message. Raises EOFError, OSError."""
        await await_message(self._commands)
        return decode_to_node(self._commands.recv_bytes())

    async def _report(self, news: ToCampaign) -> None:
        """Send news, unless nobody takes them: a reader that stands still delays no abort."""
        _, writable, _ = select.select([], [self._reports], [], 0.0)
        if not writable or self._is_sending:
            return
        content = encode_to_campaign(news)
        if len(content) <= _AT_ONCE_BYTES:
            self._write(content)
        else:
            await self._send(news)

    async def _send(self, message: ToCampaign) -> None:
        """Send a message that has to arrive, in a thread: its reader may stand still.

        It is given up where standard input has ended, too.
        """
        await self._await_sent()
        if not self._is_sending:
            self._sending = call_in_daemon_thread(partial(self._write, encode_to_campaign(message)))
            await self._await_sent()

    @property
    def _is_sending(self) -> bool:
        return self._sending is not None and not self._sending.done()

    async def _await_sent(self) -> None:
        """Wait until the message is sent that a thread sends, or is given up."""
        while self._sending is not None and not self._sending.done():
            is_deserted = _is_deserted(self._commands)
            await asyncio.wait([self._sending], timeout=_REPORT_S)
            if is_deserted:
                return

    def _write(self, content: bytes) -> None:
        with suppress(OSError):  # the reader is gone: the run's files have its result
            self._reports.send_bytes(content)


def _is_deserted(commands: Connection) -> bool:
    """Return whether the other end is closed, whatever is left to read."""
    poller = select.poll()
    poller.register(commands.fileno(), 0)
    return any(event & select.POLLHUP for _, event in poller.poll(0))


def main() -> int:
    """Serve the campaign's machine at the other end of standard input and output."""
    commands, reports = Connection(os.dup(0), writable=False), Connection(os.dup(1), readable=False)
    # Prints of the user's code must not mix with messages, and no child may read the commands.
    os.dup2(2, 1)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    reports.send_bytes(encode_to_campaign(NodeFacts(node_facts())))
    with tempfile.TemporaryDirectory(prefix="wil-campaign-") as home:
        runs = NodeRuns(commands, reports, Path(home))
        asyncio.run(runs.serve())
        runs.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
