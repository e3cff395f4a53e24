"""Agents on the nodes of a Ray cluster: hired, checked, and asked from an event loop."""

import asyncio
import pickle
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from orchestrator.campaign.workers.run_engine import EngineError
from orchestrator.engines.node_agent import NodeAgent
from orchestrator.engines.node_facts import node_facts, unfit_text
from orchestrator.engines.node_messages import DamagedMessageError, read_facts, read_message
from orchestrator.model.flight_place import FlightPlace

_HIRED_S = 300.0
"""How long is waited for a place on the cluster, and for the first import of our code there."""
_LOOK_S = 2.0
_CLOSED_S = 30.0
"""How long the process of a node may take to end, when nothing flies any more."""


@dataclass(slots=True)
class HiredAgent:
    """An agent of ours on a node. actor: Ray's handle. has_campaign: its files are unpacked.

    bench: that it serves; "" for none.
    """

    ray: Any
    actor: Any
    node: str
    has_campaign: bool = False
    is_dead: bool = False
    bench: str = ""

    @property
    def place(self) -> FlightPlace:
        """Where it flies."""
        return FlightPlace(self.node, self.bench)

    async def send(self, message: object) -> None:
        """Send a message to the node's process. Raises OSError, EOFError."""
        await self._result_of(self.actor.send.remote(pickle.dumps(message)))

    def send_soon(self, message: object) -> None:
        """Send a message without waiting; it is lost where the node is."""
        self.actor.send.remote(pickle.dumps(message))

    async def receive(self) -> Sequence[object]:
        """Return the next messages of the node's process, at least one.

        Raises EOFError, DamagedMessageError.
        """
        while True:
            received = await self._result_of(self.actor.receive.remote(_LOOK_S))
            if received:
                return [read_message(one) for one in received]

    async def close(self) -> None:
        """End the node's process, and give the place on the cluster back."""
        if not self.is_dead:
            with suppress(EOFError, OSError):  # it has ended already
                async with asyncio.timeout(_CLOSED_S):
                    await self._result_of(self.actor.close.remote())
        self.kill()

    def kill(self) -> None:
        """End the agent at once; the run that its node's process flies lands."""
        self.is_dead = True
        self.ray.kill(self.actor, no_restart=True)

    async def _result_of(self, reference: Any) -> Any:
        """Return what a call of the agent returns. Raises EOFError, OSError."""
        try:
            return await asyncio.wrap_future(reference.future())
        except self.ray.exceptions.RayError as error:
            cause = getattr(error, "cause", None)
            if not isinstance(cause, OSError | EOFError):
                self.is_dead = True
            raise EOFError(str(error)) from error


def hire_agents(ray: Any, count: int, *, cores: int) -> list[HiredAgent]:
    """Return agents that are up, on nodes that fly as this machine does. Raises EngineError.

    ray: the module. cores: of a node, that a run takes.
    """
    # Ray flies nothing again by itself: the campaign's ledger decides.
    remote = ray.remote(
        num_cpus=cores,
        max_restarts=0,
        max_task_retries=0,
        max_concurrency=8,
        scheduling_strategy="SPREAD",
    )(NodeAgent)
    actors = [remote.remote() for _ in range(count)]
    try:
        first = ray.get([actor.receive.remote(_HIRED_S) for actor in actors], timeout=_HIRED_S)
    except ray.exceptions.GetTimeoutError as error:
        _dismiss(ray, actors)
        raise EngineError(
            f"the cluster has no place for {count} runs of {cores} CPUs each within {_HIRED_S:g} "
            "s: lower --jobs, or add nodes"
        ) from error
    except ray.exceptions.RayError as error:
        _dismiss(ray, actors)
        raise EngineError(
            f"a node of the cluster cannot fly: {_last_line(error)}; install the same wheel of "
            "wil-campaign[cluster] with the same constraints on every node",
            2,
        ) from error
    if not all(first):
        _dismiss(ray, actors)
        raise EngineError(f"a node of the cluster says nothing for {_HIRED_S:g} s")
    try:
        found = [read_facts(messages[0]) for messages in first]
    except DamagedMessageError as error:
        _dismiss(ray, actors)
        raise EngineError(f"a node of the cluster does not say what it is: {error}") from error
    for facts in found:
        if why := unfit_text(node_facts(), facts):
            _dismiss(ray, actors)
            raise EngineError(why, 2)
    return [
        HiredAgent(ray=ray, actor=actor, node=facts["node"])
        for actor, facts in zip(actors, found, strict=True)
    ]


def _dismiss(ray: Any, actors: Sequence[Any]) -> None:
    for actor in actors:
        ray.kill(actor, no_restart=True)


def _last_line(error: Exception) -> str:
    """Return the line of Ray's error that says what happened."""
    return str(error).strip().splitlines()[-1].strip() if str(error).strip() else repr(error)
