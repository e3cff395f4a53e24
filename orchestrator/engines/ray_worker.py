"""A worker of the pool that stands on a node of a Ray cluster."""

import asyncio
from collections import deque
from collections.abc import Callable

from orchestrator.campaign.resuming.run_ledger import RunLedger
from orchestrator.campaign.workers.run_workers import OrderDone, WorkerLost
from orchestrator.engines.node_messages import RunEnded, RunOrdered, RunTaken
from orchestrator.engines.ray_agents import HiredAgent
from orchestrator.engines.returned_results import LANDED_S, ReturnedResults
from orchestrator.engines.travelling_files import resolve_order
from orchestrator.model.flight_place import FlightPlace
from orchestrator.model.results import RunResult
from orchestrator.state.run_setup import RunOrder
from orchestrator.storage.threads import in_thread
from safety.guard.core.operator_command import OperatorCommand

_SAY_S = 5.0


class RayWorker:
    """Flies one order by an agent. give_back: takes the agent again, also one that is lost."""

    def __init__(
        self,
        *,
        agent: HiredAgent,
        ledger: RunLedger,
        results: ReturnedResults,
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
        self._messages: deque[object] = deque()
        self._end_text = ""
        self._fetching: asyncio.Future[RunResult | WorkerLost] | None = None

    @property
    def place(self) -> FlightPlace:
        """The agent's node, and its bench."""
        return self._agent.place

    async def begin(self, order: RunOrder) -> None:
        """Enter the order into the ledger, and send it. Raises OSError, EOFError."""
        self._order = resolve_order(order)
        self._place = self._results.new_place(self._order)
        self._ledger.write("ordered", order.plan.name, self._agent.node, place=self._place)
        await self._agent.send(RunOrdered(self._order, self._place))

    async def receive(self) -> object:
        """Return the next message of the run. Raises OSError, EOFError.

        While its files come the messages are empty: nobody takes the run for one that hangs.
        """
        if self._fetching is None:
            if not self._messages:
                self._messages.extend(await self._agent.receive())
            message = self._messages.popleft()
            if not isinstance(message, RunEnded):
                return message
            self._fetching = self._fetch(message)
        await asyncio.wait([self._fetching], timeout=_SAY_S)
        if not self._fetching.done():
            return None
        return OrderDone(await self._ended(self._fetching.result()))

    def send(self, command: OperatorCommand) -> None:
        """Pass an operator's command on to the run."""
        self._agent.send_soon(command)

    def kill(self) -> None:
        """End the agent; the run lands, and its guard brings its vehicles down."""
        self._agent.kill()

    async def outcome_of_lost(self, reason: str) -> RunResult | WorkerLost:
        """Return what the run's folder says of a run whose agent is lost.

        A run that was finished counts. One that landed because it lost its worker does not.
        """
        self._agent.kill()
        order = self._order
        why = reason or f"node {self._agent.node} has lost the worker of the run"
        if order is None:
            return WorkerLost(why)
        self._say(f"{order.plan.name}: {why}; waiting up to {LANDED_S:g} s until it has landed")
        found = await in_thread(lambda: self._results.of_lost(order, self._place))
        if isinstance(found, RunResult) and found.verdict != "ABORTED":
            self._ledger.write("found", order.plan.name, self._agent.node, found.verdict)
            return found
        if isinstance(found, str):
            why = f"{why}; {found}"
        self._ledger.write("lost", order.plan.name, self._agent.node, why)
        return WorkerLost(why)

    async def end(self) -> str:
        """Give the agent back; return what was wrong with the run's end."""
        self._give_back(self._agent)
        return self._end_text

    def _fetch(self, ended: RunEnded) -> "asyncio.Future[RunResult | WorkerLost]":
        """Return what becomes the outcome of a run that a node has ended."""
        self._end_text = ended.end_text
        order = self._order
        if order is None:
            return in_thread(lambda: WorkerLost("a node ended a run that it was not given"))
        return in_thread(lambda: self._results.of_ended(order, self._place, ended))

    async def _ended(self, outcome: RunResult | WorkerLost) -> RunResult | WorkerLost:
        """Enter the outcome of a run into the ledger, and tell its node that it is here."""
        name = "" if self._order is None else self._order.plan.name
        if isinstance(outcome, RunResult):
            self._ledger.write("ended", name, self._agent.node, outcome.verdict)
        else:
            self._ledger.write("lost", name, self._agent.node, outcome.reason)
        if self._place:
            await self._agent.send(RunTaken(self._place, isinstance(outcome, RunResult)))
        return outcome
