"""A worker of the pool that stands on a node of a Ray cluster."""

import asyncio
import hashlib
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path

from orchestrator.campaign.folder.campaign_folder import TakenError, held
from orchestrator.campaign.resuming.run_ledger import RunLedger
from orchestrator.campaign.workers.run_workers import OrderDone, WorkerLost
from orchestrator.engines.node_messages import RunEnded, RunOrdered
from orchestrator.engines.ray_agents import HiredAgent
from orchestrator.engines.travelling_files import resolve_order
from orchestrator.model.results import RunResult
from orchestrator.model.results_reader import ResultError, read_result
from orchestrator.state.run_setup import RunOrder
from safety.guard.core.operator_command import OperatorCommand

_LANDED_S = 120.0
"""How long a run whose node has lost its worker may go on: it lands."""
_SHOWN_S = 20.0
"""How long a shared folder may take to show what a node has written."""
_LOOK_S = 0.2


class RayWorker:
    """Flies one order by an agent. give_back: takes the agent for the next order."""

    def __init__(
        self, *, agent: HiredAgent, ledger: RunLedger, give_back: Callable[[HiredAgent], None]
    ) -> None:
        self._agent = agent
        self._ledger = ledger
        self._give_back = give_back
        self._order: RunOrder | None = None
        self._messages: deque[object] = deque()
        self._end_text = ""

    async def begin(self, order: RunOrder) -> None:
        """Enter the order into the ledger, and send it. Raises OSError, EOFError."""
        self._order = resolve_order(order)
        self._ledger.write("ordered", order.plan.name, self._agent.node)
        await self._agent.send(RunOrdered(self._order))

    async def receive(self) -> object:
        """Return the next message of the run. Raises OSError, EOFError."""
        if not self._messages:
            self._messages.extend(await self._agent.receive())
        message = self._messages.popleft()
        if not isinstance(message, RunEnded):
            return message
        return OrderDone(await self._ended(message))

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
        loop = asyncio.get_running_loop()
        found = await loop.run_in_executor(None, _result_on_disk, order.folder)
        if isinstance(found, RunResult) and found.verdict != "ABORTED":
            self._ledger.write("found", order.plan.name, self._agent.node, found.verdict)
            return found
        if isinstance(found, str):
            why = f"{why}; {found}"
        self._ledger.write("lost", order.plan.name, self._agent.node, why)
        return WorkerLost(why)

    async def end(self) -> str:
        """Give the agent back, unless it is lost; return what was wrong with the run's end."""
        if not self._agent.is_dead:
            self._give_back(self._agent)
        return self._end_text

    async def _ended(self, ended: RunEnded) -> RunResult | WorkerLost:
        """Return the outcome of a run that a node has ended, once its result is on our disk."""
        self._end_text = ended.end_text
        outcome, order = ended.outcome, self._order
        if order is None:
            return WorkerLost("a node ended a run that it was not given")
        name, node = order.plan.name, self._agent.node
        if isinstance(outcome, RunResult):
            path = order.folder / "result.json"
            loop = asyncio.get_running_loop()
            if not await loop.run_in_executor(None, _has_come, path, ended.sha256):
                outcome = WorkerLost(
                    f"{path} is not what node {node} wrote, after {_SHOWN_S:g} s; share the folder "
                    "of --out with every node"
                )
        if isinstance(outcome, RunResult):
            self._ledger.write("ended", name, node, outcome.verdict)
        else:
            self._ledger.write("lost", name, node, outcome.reason)
        return outcome


def _has_come(path: Path, sha256: str) -> bool:
    """Return whether a file is there with this content, within the time that it may take."""
    for _ in range(round(_SHOWN_S / _LOOK_S)):
        try:
            if hashlib.sha256(path.read_bytes()).hexdigest() == sha256:
                return True
        except OSError:
            pass
        time.sleep(_LOOK_S)
    return False


def _result_on_disk(folder: Path) -> RunResult | str:
    """Return a run's result once nothing flies into its folder; in words where there is none."""
    if not folder.is_dir():
        return "it had not begun"
    for _ in range(round(_LANDED_S / _LOOK_S)):
        try:
            with held(folder):
                return read_result(folder / "result.json")
        except TakenError:
            time.sleep(_LOOK_S)
        except (ResultError, OSError) as error:
            return str(error)
    return f"it was in flight still after {_LANDED_S:g} s"
