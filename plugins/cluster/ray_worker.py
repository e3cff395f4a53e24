"""A worker of the pool that flies its run on a node of a Ray cluster."""

import asyncio
from collections import deque
from collections.abc import Callable

from wil_campaign.foundation.processes.codec import ProcessMessageError
from wil_campaign.orchestrator.campaign.resuming.cluster_ledger import RunLedger
from wil_campaign.orchestrator.campaign.workers.run_engine import EngineError
from wil_campaign.orchestrator.campaign.workers.run_order import resolve_order
from wil_campaign.orchestrator.campaign.workers.run_workers import OrderDone, WorkerLost
from wil_campaign.orchestrator.operator.run_messages import FlightPlace
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder
from wil_campaign.plugins.cluster.node_messages import (
    CommandSent,
    NodeRunHappening,
    NodeRunProgress,
    RunEnded,
    RunOrdered,
    RunTaken,
    ToCampaign,
    encode_to_node,
)
from wil_campaign.plugins.cluster.ray_agents import HiredAgent
from wil_campaign.plugins.cluster.returned_results import LANDED_S, FetchedResults
from wil_campaign.plugins.cluster.stored_runs import RESULT_FILE
from wil_campaign.plugins.cluster.threads import call_in_daemon_thread
from wil_campaign.safety.guard.core.operator_command import OperatorCommand

_REPORT_S = 5.0
_LANDED = "result.landed.json"
"""The result of a run that landed because it lost its worker."""


class RayWorker:
    """Flies one order by an agent. give_back: takes back the agent, also a lost one."""

    def __init__(
        self,
        *,
        agent: HiredAgent,
        ledger: RunLedger,
        results: FetchedResults,
        give_back: Callable[[HiredAgent], None],
        say: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._say = say
        self._agent = agent
        self._ledger = ledger
        self._results = results
        self._give_back = give_back
        self._order: RunOrder | None = None
        self._place = ""
        self._messages: deque[ToCampaign] = deque()
        self._end_text = ""
        self._fetching: asyncio.Future[RunResult | WorkerLost] | None = None

    @property
    def place(self) -> FlightPlace:
        """Return the node and bench of the agent."""
        return self._agent.place

    async def begin(self, order: RunOrder) -> None:
        """Write the order to the ledger and send it. Raises OSError, EOFError, EngineError."""
        self._order = resolve_order(order)
        self._place = self._results.new_place(self._order)
        try:
            packet = encode_to_node(RunOrdered(self._order, self._place))
        except ProcessMessageError as error:
            raise EngineError(f"{order.plan.name}: {error}", 2) from error
        self._ledger.write("ordered", order.plan.name, self._agent.node, place=self._place)
        await self._agent.send_packet(packet)

    async def receive(self) -> object:
        """Return the next message of the run. Raises OSError, EOFError.

        While the run's files are fetched it returns None now and then, as a sign of life.
        """
        if self._fetching is None:
            if not self._messages:
                self._messages.extend(await self._agent.receive())
            message = self._messages.popleft()
            if isinstance(message, NodeRunProgress | NodeRunHappening):
                return message.news
            if not isinstance(message, RunEnded):
                return message
            self._fetching = self._fetch(message)
        await asyncio.wait([self._fetching], timeout=_REPORT_S)
        if not self._fetching.done():
            return None
        return OrderDone(await self._confirm_end(self._fetching.result()))

    def send(self, command: OperatorCommand) -> None:
        """Pass an operator's command on to the run."""
        try:
            self._agent.send_soon(CommandSent(command))
        except ProcessMessageError as error:
            self._say(f"{command.kind} was not passed on to node {self._agent.node}: {error}")

    def kill(self) -> None:
        """End the agent; the run lands, or its guard brings its vehicles down."""
        self._agent.kill()

    async def outcome_of_lost(self, reason: str) -> RunResult | WorkerLost:
        """Return the outcome of a run whose agent is lost, from the run's files.

        A finished run counts. One that landed because it lost its worker does not.
        """
        self._agent.kill()
        order = self._order
        why = reason or f"node {self._agent.node} has lost the worker of the run"
        if order is None:
            return WorkerLost(why)
        self._say(f"{order.plan.name}: {why}; waiting up to {LANDED_S:g} s until it has landed")
        result = await call_in_daemon_thread(lambda: self._results.of_lost(order, self._place))
        if isinstance(result, RunResult) and result.verdict != "ABORTED":
            self._ledger.write("found", order.plan.name, self._agent.node, result.verdict)
            return result
        if isinstance(result, str):
            why = f"{why}; {result}"
        else:  # it does not count, and the campaign writes what counts
            (order.folder / RESULT_FILE).rename(order.folder / _LANDED)
        self._ledger.write("lost", order.plan.name, self._agent.node, why)
        return WorkerLost(why)

    async def end(self) -> str:
        """Give back the agent; return what was wrong with the run's end."""
        self._give_back(self._agent)
        return self._end_text

    def _fetch(self, ended: RunEnded) -> "asyncio.Future[RunResult | WorkerLost]":
        self._end_text = ended.end_text
        order = self._order
        if order is None:
            return call_in_daemon_thread(
                lambda: WorkerLost("the node reports the end of a run that was not ordered")
            )
        return call_in_daemon_thread(lambda: self._results.of_ended(order, self._place, ended))

    async def _confirm_end(self, outcome: RunResult | WorkerLost) -> RunResult | WorkerLost:
        """Write a run's outcome to the ledger, and confirm to the node that it has arrived.

        A node that has ended meanwhile, as a bench does after Ctrl-C, takes nothing away from it.
        """
        name = "" if self._order is None else self._order.plan.name
        if isinstance(outcome, RunResult):
            self._ledger.write("ended", name, self._agent.node, outcome.verdict)
        else:
            self._ledger.write("lost", name, self._agent.node, outcome.reason)
        try:
            await self._agent.send(RunTaken(self._place, isinstance(outcome, RunResult)))
        except (EOFError, OSError):
            self._agent.kill()
        return outcome
